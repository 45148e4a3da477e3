//! Voxel grids: what Q-attention sees of a coloured point cloud at one depth (section III-B of the
//! paper).
//!
//! Arrays over voxels are in the order z, y, x (x runs fastest); the functions of [`VoxelSpace`]
//! are the only ones that know it.
//!
//! # Differences from the released code
//!
//! Its flat index is right for cubes only; here every count per axis may differ.

use crate::error::{Error, Result};
use crate::robot::Robot;
use glamx::Vec3;
use serde::{Deserialize, Serialize};

/// Channels of a grid: mean position (3, metres), mean colour (3, -1 to 1), index over count (3),
/// occupied (1).
pub const VOXEL_CHANNELS: usize = 10;

/// Sides of the box that is voxelised at the first depth, metres (the released code's scene
/// bounds).
const SCENE_SIDE: f32 = 1.0;
/// Lower corner of that box from the workspace's centre, metres.
const SCENE_CORNER: Vec3 = Vec3::new(-0.55, -0.5, -0.15);

/// An axis-aligned box in the world.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct VoxelBounds {
    /// Lower corner, metres.
    pub min: Vec3,
    /// Length of the sides along x, y, z, metres.
    pub size: Vec3,
}

impl VoxelBounds {
    /// The box of the first depth for `robot`: one metre a side around its workspace.
    ///
    /// # Errors
    ///
    /// When the arm's workspace is not known: files describe none.
    pub fn scene(robot: &Robot) -> Result<Self> {
        let min = robot.workspace_center()?.extend(0.0) + SCENE_CORNER;
        Ok(Self { min, size: Vec3::splat(SCENE_SIDE) })
    }

    /// The cube of all points within `half_width` (metres) of `center` along every axis: the box of
    /// a later depth.
    #[must_use]
    pub fn cube(center: Vec3, half_width: f32) -> Self {
        Self { min: center - Vec3::splat(half_width), size: Vec3::splat(2.0 * half_width) }
    }

    /// Upper corner, metres.
    #[must_use]
    pub fn max(&self) -> Vec3 {
        self.min + self.size
    }

    /// True if the point is within; the upper faces are not.
    #[must_use]
    pub fn contains(&self, point: Vec3) -> bool {
        point.cmpge(self.min).all() && point.cmplt(self.max()).all()
    }
}

/// A voxel by its indices along x, y and z.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct VoxelIndex {
    /// Index along x.
    pub x: usize,
    /// Index along y.
    pub y: usize,
    /// Index along z.
    pub z: usize,
}

/// A box divided into voxels.
///
/// ```
/// use lpr_core::glamx::Vec3;
/// use lpr_core::perception::{VoxelBounds, VoxelIndex, VoxelSpace};
///
/// let space = VoxelSpace::new(VoxelBounds::cube(Vec3::ZERO, 0.5), [10, 10, 10])?;
/// let voxel = VoxelIndex { x: 9, y: 5, z: 0 };
/// assert_eq!(space.voxel_from_point(Vec3::new(0.49, 0.01, -0.49)), Some(voxel));
/// assert!(space.point_from_voxel(voxel).distance(Vec3::new(0.45, 0.05, -0.45)) < 1e-6, "its centre");
/// assert_eq!(space.flat_from_voxel(voxel), 59, "x runs fastest");
/// assert_eq!(space.voxel_from_point(Vec3::new(0.5, 0.0, 0.0)), None, "the upper faces are outside");
/// # Ok::<(), lpr_core::Error>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct VoxelSpace {
    bounds: VoxelBounds,
    counts: [usize; 3],
    side: Vec3,
    per_metre: Vec3,
}

impl VoxelSpace {
    /// `bounds` divided into `voxels_per_side` voxels along x, y, z.
    ///
    /// # Errors
    ///
    /// When the box has no volume or there are no voxels, or more than 65536 of them (the limit of
    /// [`super::CompactGrid`]).
    pub fn new(bounds: VoxelBounds, voxels_per_side: [usize; 3]) -> Result<Self> {
        let n_voxels = voxels_per_side.iter().try_fold(1_usize, |n, count| n.checked_mul(*count));
        if !n_voxels.is_some_and(|n| (1..=MAX_VOXELS).contains(&n)) {
            return Err(Error::Config(format!(
                "voxels: expected 1 to {MAX_VOXELS} in all, found {voxels_per_side:?}"
            )));
        }
        if !(bounds.min.is_finite()
            && bounds.size.is_finite()
            && bounds.size.cmpgt(Vec3::ZERO).all())
        {
            return Err(Error::Config(format!(
                "voxel bounds: expected a volume, found {bounds:?}"
            )));
        }
        let counts = Vec3::from_array(voxels_per_side.map(|count| count as f32));
        Ok(Self {
            bounds,
            counts: voxels_per_side,
            side: bounds.size / counts,
            per_metre: counts / bounds.size,
        })
    }

    /// The box.
    #[must_use]
    pub fn bounds(&self) -> &VoxelBounds {
        &self.bounds
    }

    /// Voxels along x, y, z.
    #[must_use]
    pub fn voxels_per_side(&self) -> [usize; 3] {
        self.counts
    }

    /// Voxels in all.
    #[must_use]
    pub fn n_voxels(&self) -> usize {
        self.counts.iter().product()
    }

    /// Sides of one voxel along x, y, z, metres.
    #[must_use]
    pub fn voxel_size(&self) -> Vec3 {
        self.side
    }

    /// The voxel that holds `point`, or `None` outside the box and for NaN.
    #[must_use]
    pub fn voxel_from_point(&self, point: Vec3) -> Option<VoxelIndex> {
        let scaled = self.scaled(point).to_array();
        let is_inside =
            |axis: usize| scaled[axis] >= 0.0 && scaled[axis] < self.counts[axis] as f32;
        let [x, y, z] = scaled.map(|value| value as i32 as usize);
        (is_inside(0) && is_inside(1) && is_inside(2)).then_some(VoxelIndex { x, y, z })
    }

    /// The voxel nearest to `point`: its own inside the box, one of the shell for a point outside.
    #[must_use]
    pub fn nearest_voxel(&self, point: Vec3) -> VoxelIndex {
        let scaled = self.scaled(point).to_array();
        // Casts saturate at zero.
        let [x, y, z] = [0, 1, 2].map(|axis| (scaled[axis] as usize).min(self.counts[axis] - 1));
        VoxelIndex { x, y, z }
    }

    /// A point in units of voxels from the lower corner.
    fn scaled(&self, point: Vec3) -> Vec3 {
        (point - self.bounds.min) * self.per_metre
    }

    /// Centre of a voxel, metres.
    #[must_use]
    pub fn point_from_voxel(&self, voxel: VoxelIndex) -> Vec3 {
        self.corner(voxel) + 0.5 * self.side
    }

    /// Position of a voxel in arrays over voxels.
    #[must_use]
    pub fn flat_from_voxel(&self, voxel: VoxelIndex) -> usize {
        let [nx, ny, nz] = self.counts;
        debug_assert!(
            voxel.x < nx && voxel.y < ny && voxel.z < nz,
            "{voxel:?} of {:?}",
            self.counts
        );
        (voxel.z * ny + voxel.y) * nx + voxel.x
    }

    /// The voxel at a position in arrays over voxels; inverts [`Self::flat_from_voxel`].
    #[must_use]
    pub fn voxel_from_flat(&self, flat: usize) -> VoxelIndex {
        let [nx, ny, _] = self.counts;
        debug_assert!(flat < self.n_voxels(), "{flat} of {}", self.n_voxels());
        VoxelIndex { x: flat % nx, y: flat / nx % ny, z: flat / (nx * ny) }
    }

    /// Lower corner of a voxel, metres.
    pub(super) fn corner(&self, voxel: VoxelIndex) -> Vec3 {
        self.bounds.min + self.side * Vec3::new(voxel.x as f32, voxel.y as f32, voxel.z as f32)
    }
}

/// A voxelised point cloud: the network's input.
///
/// ```
/// use lpr_core::glamx::Vec3;
/// use lpr_core::perception::{VoxelBounds, VoxelGrid, VoxelIndex, VoxelSpace};
///
/// let space = VoxelSpace::new(VoxelBounds::cube(Vec3::ZERO, 0.5), [2, 2, 2])?;
/// let cloud = [(Vec3::splat(0.1), [255, 0, 0]), (Vec3::splat(0.3), [255, 0, 0]), (Vec3::splat(9.0), [0, 0, 0])];
/// let grid = VoxelGrid::voxelise(cloud, space);
/// let upper = VoxelIndex { x: 1, y: 1, z: 1 };
/// assert!(grid.is_occupied(upper) && !grid.is_occupied(VoxelIndex { x: 0, ..upper }));
/// assert!((grid.channel(0)[7] - 0.2).abs() < 1e-6, "mean x of the two points");
/// assert_eq!((grid.channel(3)[7], grid.channel(4)[7]), (1.0, -1.0), "all red, no green");
/// # Ok::<(), lpr_core::Error>(())
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct VoxelGrid {
    /// The voxels.
    pub space: VoxelSpace,
    /// Features, `[C, D, H, W]`: channels as in [`VOXEL_CHANNELS`], then z, y, x.
    ///
    /// Empty voxels hold zeros but for the index channels.
    pub features: Vec<f32>,
}

impl VoxelGrid {
    /// The mean position and colour of the points in each voxel; points outside the box are
    /// dropped.
    #[must_use]
    pub fn voxelise(points: impl IntoIterator<Item = (Vec3, [u8; 3])>, space: VoxelSpace) -> Self {
        let mut sums = vec![Sum::default(); space.n_voxels()];
        for (point, rgb) in points {
            if let Some(voxel) = space.voxel_from_point(point) {
                sums[space.flat_from_voxel(voxel)].add(point, rgb);
            }
        }
        let mut grid = Self::empty(space);
        for (flat, sum) in sums.iter().enumerate().filter(|(_, sum)| sum.n_points > 0.0) {
            let rgb = sum.rgb / sum.n_points;
            grid.occupy(flat, sum.position / sum.n_points, rgb * (2.0 / 255.0) - Vec3::ONE);
        }
        grid
    }

    /// A grid without points.
    #[must_use]
    pub fn empty(space: VoxelSpace) -> Self {
        let mut features = vec![0.0; VOXEL_CHANNELS * space.n_voxels()];
        write_indices(&space, &mut features);
        Self { space, features }
    }

    /// One channel over all voxels, `[D, H, W]`.
    #[must_use]
    pub fn channel(&self, channel: usize) -> &[f32] {
        let n = self.space.n_voxels();
        &self.features[channel * n..(channel + 1) * n]
    }

    /// All channels of one voxel.
    #[must_use]
    pub fn voxel(&self, flat: usize) -> [f32; VOXEL_CHANNELS] {
        let n = self.space.n_voxels();
        core::array::from_fn(|channel| self.features[channel * n + flat])
    }

    /// True if the voxel holds points.
    #[must_use]
    pub fn is_occupied(&self, voxel: VoxelIndex) -> bool {
        self.channel(OCCUPIED)[self.space.flat_from_voxel(voxel)] > 0.0
    }

    fn occupy(&mut self, flat: usize, position: Vec3, color: Vec3) {
        write_occupied(&mut self.features, self.space.n_voxels(), flat, position, color);
    }
}

/// First channel of the voxel's indices.
pub(crate) const INDEX: usize = 6;
/// Channel of occupancy.
pub(super) const OCCUPIED: usize = 9;
/// Voxels that a `u16` can number.
const MAX_VOXELS: usize = 1 << 16;

#[derive(Debug, Clone, Copy, Default)]
struct Sum {
    position: Vec3,
    rgb: Vec3,
    n_points: f32,
}

impl Sum {
    fn add(&mut self, point: Vec3, rgb: [u8; 3]) {
        self.position += point;
        self.rgb += Vec3::from_array(rgb.map(f32::from));
        self.n_points += 1.0;
    }
}

/// Fills the index channels of `features`.
pub(super) fn write_indices(space: &VoxelSpace, features: &mut [f32]) {
    let n = space.n_voxels();
    let [nx, ny, nz] = space.voxels_per_side().map(|count| count as f32);
    for flat in 0..n {
        let VoxelIndex { x, y, z } = space.voxel_from_flat(flat);
        for (channel, fraction) in
            [x as f32 / nx, y as f32 / ny, z as f32 / nz].into_iter().enumerate()
        {
            features[(INDEX + channel) * n + flat] = fraction;
        }
    }
}

pub(super) fn write_occupied(
    features: &mut [f32],
    n_voxels: usize,
    flat: usize,
    position: Vec3,
    color: Vec3,
) {
    let values = position.to_array().into_iter().chain(color.to_array());
    for (channel, value) in values.enumerate() {
        features[channel * n_voxels + flat] = value;
    }
    features[OCCUPIED * n_voxels + flat] = 1.0;
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use crate::robot::PANDA;
    use proptest::prelude::*;

    /// A space that is no cube.
    pub(in crate::perception) fn space() -> VoxelSpace {
        let bounds =
            VoxelBounds { min: Vec3::new(-0.2, 0.1, -0.3), size: Vec3::new(0.4, 0.9, 1.6) };
        VoxelSpace::new(bounds, [4, 6, 8]).expect("a proper space")
    }

    /// Points inside and outside of it.
    pub(in crate::perception) fn cloud() -> impl Strategy<Value = Vec<(Vec3, [u8; 3])>> {
        let point = (-0.3f32..0.3, 0.0f32..1.1, -0.4f32..1.4, any::<[u8; 3]>());
        proptest::collection::vec(
            point.prop_map(|(x, y, z, rgb)| (Vec3::new(x, y, z), rgb)),
            0..300,
        )
    }

    #[test]
    fn scene_bounds_are_rlbenchs_in_our_world() {
        let bounds = VoxelBounds::scene(&PANDA).unwrap();
        assert!((bounds.min - Vec3::new(-0.03, -0.5, -0.15)).length() < 1e-6);
        assert!((bounds.max() - Vec3::new(0.97, 0.5, 0.85)).length() < 1e-6);
    }

    #[test]
    fn flat_indices_cover_a_space_that_is_no_cube_once() {
        let space = space();
        for flat in 0..space.n_voxels() {
            assert_eq!(space.flat_from_voxel(space.voxel_from_flat(flat)), flat);
        }
        let last = VoxelIndex { x: 3, y: 5, z: 7 };
        assert_eq!(space.flat_from_voxel(last), space.n_voxels() - 1);
        assert_eq!(space.flat_from_voxel(VoxelIndex { x: 1, y: 0, z: 0 }), 1, "x runs fastest");
    }

    #[test]
    fn centers_lie_in_their_voxels() {
        let space = space();
        for flat in 0..space.n_voxels() {
            let voxel = space.voxel_from_flat(flat);
            assert_eq!(space.voxel_from_point(space.point_from_voxel(voxel)), Some(voxel));
        }
    }

    #[test]
    fn points_outside_or_that_are_no_numbers_have_no_voxel() {
        let space = space();
        let max = space.bounds().max();
        for point in [
            Vec3::INFINITY,
            Vec3::NAN,
            max,
            space.bounds().min - Vec3::X * 1e-6,
            Vec3::new(0.0, 5.0, 0.0),
        ] {
            assert_eq!(space.voxel_from_point(point), None, "{point}");
        }
        assert_eq!(space.nearest_voxel(max), VoxelIndex { x: 3, y: 5, z: 7 });
        assert_eq!(space.nearest_voxel(Vec3::splat(-9.0)), VoxelIndex { x: 0, y: 0, z: 0 });
        assert!(space.voxel_from_point(space.bounds().min).is_some());
    }

    #[test]
    fn a_voxel_holds_means_index_and_occupancy() {
        let bounds = VoxelBounds::cube(Vec3::ZERO, 1.0);
        let space = VoxelSpace::new(bounds, [2, 4, 8]).expect("a proper space");
        let points =
            [(Vec3::new(0.1, 0.2, 0.1), [255, 0, 0]), (Vec3::new(0.3, 0.4, 0.1), [0, 0, 255])];
        let grid = VoxelGrid::voxelise(points, space);
        let voxel = VoxelIndex { x: 1, y: 2, z: 4 };
        let flat = space.flat_from_voxel(voxel);
        let expected = [0.2, 0.3, 0.1, 0.0, -1.0, 0.0, 0.5, 0.5, 0.5, 1.0];
        for (channel, value) in expected.into_iter().enumerate() {
            assert!((grid.channel(channel)[flat] - value).abs() < 1e-6, "channel {channel}");
        }
        assert!(grid.is_occupied(voxel));
        assert_eq!(grid.channel(OCCUPIED).iter().sum::<f32>(), 1.0);
        let empty = space.flat_from_voxel(VoxelIndex { x: 0, y: 3, z: 6 });
        let values: Vec<_> =
            (0..VOXEL_CHANNELS).map(|channel| grid.channel(channel)[empty]).collect();
        assert_eq!(values, [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.75, 0.75, 0.0]);
    }

    #[test]
    fn spaces_without_voxels_or_volume_are_errors() {
        let bounds = VoxelBounds::cube(Vec3::ZERO, 1.0);
        assert!(VoxelSpace::new(bounds, [16, 0, 16]).is_err());
        assert!(VoxelSpace::new(bounds, [64, 64, 32]).is_err());
        assert!(VoxelSpace::new(bounds, [usize::MAX; 3]).is_err());
        // The product of these is 1 in 64 bits.
        assert!(VoxelSpace::new(bounds, [3, 0xaaaa_aaaa_aaaa_aaab, 1]).is_err());
        assert!(VoxelSpace::new(VoxelBounds::cube(Vec3::ZERO, 0.0), [16; 3]).is_err());
        assert!(VoxelSpace::new(VoxelBounds::cube(Vec3::NAN, 1.0), [16; 3]).is_err());
    }

    proptest! {
        #[test]
        fn means_lie_in_their_voxels_and_all_inner_points_count(points in cloud()) {
            let space = space();
            let grid = VoxelGrid::voxelise(points.iter().copied(), space);
            for flat in 0..space.n_voxels() {
                let voxel = space.voxel_from_flat(flat);
                let inner: Vec<_> = points.iter().filter(|(p, _)| space.voxel_from_point(*p) == Some(voxel)).collect();
                prop_assert_eq!(grid.is_occupied(voxel), !inner.is_empty());
                if inner.is_empty() {
                    continue;
                }
                let mean = inner.iter().map(|(p, _)| *p).sum::<Vec3>() / inner.len() as f32;
                let stored = Vec3::new(grid.channel(0)[flat], grid.channel(1)[flat], grid.channel(2)[flat]);
                prop_assert!((stored - mean).length() < 1e-5);
                let from_center = (stored - space.point_from_voxel(voxel)).abs();
                prop_assert!(from_center.cmple(0.5 * space.voxel_size() + 1e-5).all());
            }
        }
    }
}
