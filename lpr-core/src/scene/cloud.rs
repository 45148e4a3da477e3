//! A point cloud as an obstacle: balls around its points, found through a uniform grid.
//!
//! Every cell knows a lower bound of its distance to the nearest point, so most queries end after
//! one look-up.

use super::frames::{Frames, MAX_WIDTH};
use super::link_spheres::Links;
use crate::lanes::{Floats, Vec3s};
use crate::robot::Sphere;
use fearless_simd::{Simd, SimdBase as _, SimdFloat as _, SimdMask as _};
use glamx::Vec3;

/// Side of a cell, metres; larger when the cloud would need more than [`MAX_CELLS`].
const CELL: f32 = 0.025;
/// Most cells of a grid: 2 MB of bounds.
const MAX_CELLS: usize = 1 << 21;
/// Points further from the origin than this along an axis are dropped, metres.
const MAX_COORDINATE: f32 = 1000.0;
/// Distances are resolved up to this many cells; beyond, a cell is only known to be further away.
const WINDOW: usize = 10;
/// Squared gap, in cells, to a point outside the window: the least that is known of it.
const FAR: u8 = (WINDOW * WINDOW) as u8;

/// Balls of one radius around points, with fast queries.
///
/// ```
/// use lpr_core::glamx::Vec3;
/// use lpr_core::scene::PointCloud;
///
/// let cloud = PointCloud::new(&[Vec3::ZERO, Vec3::X, Vec3::NAN], 0.01);
/// assert_eq!(cloud.points().len(), 2, "what is not finite is dropped");
/// // Two balls of 1 cm and 4 cm meet at up to 5 cm.
/// assert!(cloud.touches(Vec3::new(0.0, 0.049, 0.0), 0.04));
/// assert!(!cloud.touches(Vec3::new(0.0, 0.051, 0.0), 0.04));
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct PointCloud {
    /// Radius of the ball around every point, metres.
    point_radius: f32,
    /// Points sorted by cell.
    points: Vec<Vec3>,
    grid: Grid,
    /// Index of the first point of every cell, and the number of points last.
    cell_starts: Vec<u32>,
    /// Lower bound of the squared distance from anywhere in the cell to any point, in squared
    /// cells.
    squared_gaps: Vec<u8>,
}

/// Cells over the bounding box of the points, x fastest.
#[derive(Debug, Clone, PartialEq)]
struct Grid {
    low: Vec3,
    high: Vec3,
    cell: f32,
    cells: [usize; 3],
}

impl PointCloud {
    /// A cloud of balls of `point_radius` (metres) around `points`; points that are not finite are
    /// dropped.
    #[must_use]
    pub fn new(points: &[Vec3], point_radius: f32) -> Self {
        let points: Vec<Vec3> = points.iter().copied().filter(|point| is_usable(*point)).collect();
        let grid = Grid::around(&points);
        let (points, cell_starts) = sort_by_cell(&points, &grid);
        let squared_gaps = squared_gaps(&grid, &cell_starts);
        Self { point_radius, points, grid, cell_starts, squared_gaps }
    }

    /// The points, sorted by cell.
    #[must_use]
    pub fn points(&self) -> &[Vec3] {
        &self.points
    }

    /// Radius of the ball around every point, metres.
    #[must_use]
    pub const fn point_radius(&self) -> f32 {
        self.point_radius
    }

    /// True if a ball at `center` meets the ball of any point. Metres.
    #[must_use]
    pub fn touches(&self, center: Vec3, radius: f32) -> bool {
        !self.is_surely_clear(center, radius) && self.search(center, radius + self.point_radius)
    }

    /// The point nearest `center`, if one lies within `reach` of it. Metres.
    ///
    /// ```
    /// use lpr_core::glamx::Vec3;
    /// use lpr_core::scene::PointCloud;
    ///
    /// let cloud = PointCloud::new(&[Vec3::ZERO, Vec3::X], 0.01);
    /// let asked = Vec3::new(0.7, 0.0, 0.0);
    /// assert_eq!(cloud.nearest_within(asked, 0.5), Some(Vec3::X));
    /// assert_eq!(cloud.nearest_within(asked, 0.2), None, "the reach is to the point, not to its ball");
    /// ```
    #[must_use]
    pub fn nearest_within(&self, center: Vec3, reach: f32) -> Option<Vec3> {
        if self.is_surely_clear(center, reach) {
            return None;
        }
        let low = self.grid.coordinates((center - reach).clamp(self.grid.low, self.grid.high));
        let high = self.grid.coordinates((center + reach).clamp(self.grid.low, self.grid.high));
        let rows = (low[2]..=high[2]).flat_map(|z| (low[1]..=high[1]).map(move |y| [low[0], y, z]));
        let points = rows.flat_map(|row| {
            let first = self.grid.index(row);
            &self.points[self.cell_starts[first] as usize
                ..self.cell_starts[first + high[0] - low[0] + 1] as usize]
        });
        let distances = points.map(|point| ((*point - center).length_squared(), *point));
        let within = distances.filter(|(squared, _)| *squared <= reach * reach);
        within.min_by(|(a, _), (b, _)| a.total_cmp(b)).map(|(_, point)| point)
    }

    /// True if the grid alone shows that a ball at `center` meets no point: quick, and never true
    /// by mistake.
    ///
    /// ```
    /// use lpr_core::glamx::Vec3;
    /// use lpr_core::scene::PointCloud;
    ///
    /// let cloud = PointCloud::new(&[Vec3::ZERO, Vec3::new(0.1, 0.0, 0.0)], 0.01);
    /// assert!(cloud.is_surely_clear(Vec3::Z, 0.5));
    /// let between = Vec3::new(0.05, 0.0, 0.0);
    /// assert!(!cloud.touches(between, 0.03) && !cloud.is_surely_clear(between, 0.03), "clear, at a closer look");
    /// ```
    #[must_use]
    pub fn is_surely_clear(&self, center: Vec3, radius: f32) -> bool {
        if self.points.is_empty() {
            return true;
        }
        let inside = center.clamp(self.grid.low, self.grid.high);
        // Projecting on the box of the points brings the centre closer to each of them, by at least
        // the squared way.
        let outside = center - inside;
        let gap = f32::from(self.squared_gaps[self.grid.index(self.grid.coordinates(inside))])
            * self.grid.cell
            * self.grid.cell;
        let reach = radius + self.point_radius;
        outside.dot(outside) + gap > reach * reach
    }

    /// True if in any lane a sphere of one of `links`, around which is a bounding sphere of that
    /// radius with its centre at `bound`, meets the ball of a point.
    #[inline(always)]
    pub(super) fn meet<S: Simd>(
        &self,
        simd: S,
        links: Links<'_>,
        frame: &Frames<S>,
        (bound, radius): (Vec3s<S>, f32),
    ) -> bool {
        if self.points.is_empty() || self.perhaps_near(simd, bound, radius) == 0 {
            return false;
        }
        for link in links {
            for cluster in &link.clusters {
                let Sphere { center, radius } = cluster.bound;
                if self.perhaps_near(simd, frame.point(center), radius) == 0 {
                    continue;
                }
                for sphere in &cluster.spheres {
                    let center = frame.point(sphere.center);
                    let lanes = self.perhaps_near(simd, center, sphere.radius);
                    if lanes != 0
                        && self.search_lanes(
                            lanes,
                            center.x.as_slice(),
                            center.y.as_slice(),
                            center.z.as_slice(),
                            sphere.radius,
                        )
                    {
                        return true;
                    }
                }
            }
        }
        false
    }

    /// The lanes, as bits, in which the grid alone does not show that a ball meets no point:
    /// [`Self::is_surely_clear`] otherwise.
    #[inline(always)]
    fn perhaps_near<S: Simd>(&self, simd: S, center: Vec3s<S>, radius: f32) -> u64 {
        let grid = &self.grid;
        let inside: Vec3s<S> = Vec3s {
            x: center.x.max(grid.low.x).min(grid.high.x),
            y: center.y.max(grid.low.y).min(grid.high.y),
            z: center.z.max(grid.low.z).min(grid.high.z),
        };
        let [nx, ny, nz] = grid.cells.map(|count| count as i32);
        let from_corner = inside.minus(grid.low);
        let x = (from_corner.x / grid.cell).to_int::<S::i32s>();
        let y = (from_corner.y / grid.cell).to_int::<S::i32s>();
        let z = (from_corner.z / grid.cell).to_int::<S::i32s>();
        let index = (z.min(nz - 1) * ny + y.min(ny - 1)) * nx + x.min(nx - 1);
        let mut gaps = [0.0; MAX_WIDTH];
        for (gap, index) in gaps.iter_mut().zip(index.as_slice()) {
            *gap = f32::from(self.squared_gaps[*index as usize]);
        }
        let gap = Floats::<S>::from_slice(simd, &gaps[..Floats::<S>::LEN]) * grid.cell * grid.cell;
        let reach = radius + self.point_radius;
        (center.sub(inside).length_squared() + gap).simd_le(reach * reach).to_bitmask()
    }

    fn search_lanes(&self, lanes: u64, x: &[f32], y: &[f32], z: &[f32], radius: f32) -> bool {
        let reach = radius + self.point_radius;
        (0..x.len()).any(|lane| {
            lanes & (1 << lane) != 0 && self.search(Vec3::new(x[lane], y[lane], z[lane]), reach)
        })
    }

    /// True if any point lies within `reach` of `center`.
    fn search(&self, center: Vec3, reach: f32) -> bool {
        let low = self.grid.coordinates((center - reach).clamp(self.grid.low, self.grid.high));
        let high = self.grid.coordinates((center + reach).clamp(self.grid.low, self.grid.high));
        (low[2]..=high[2]).any(|z| {
            (low[1]..=high[1]).any(|y| {
                let first = self.grid.index([low[0], y, z]);
                let row = self.cell_starts[first] as usize
                    ..self.cell_starts[first + high[0] - low[0] + 1] as usize;
                self.points[row]
                    .iter()
                    .any(|point| (*point - center).length_squared() <= reach * reach)
            })
        })
    }
}

/// One point for every cube of side `voxel` (metres, at least a millimetre) that holds any: the
/// first of `points` in it.
///
/// Points that are not finite or further than a kilometre away are dropped. The result is ordered
/// by cube.
///
/// ```
/// use lpr_core::glamx::Vec3;
/// use lpr_core::scene::downsample;
///
/// let along_x = |x: f32| Vec3::new(x, 0.0, 0.0);
/// let points = [along_x(0.012), along_x(0.004), along_x(0.018), Vec3::NAN];
/// assert_eq!(downsample(&points, 0.01), [along_x(0.004), along_x(0.012)]);
/// ```
#[must_use]
pub fn downsample(points: &[Vec3], voxel: f32) -> Vec<Vec3> {
    /// Bits of a cube's index along one axis.
    const BITS: u32 = 21;
    /// With smaller cubes, their indices would not reach a kilometre, metres.
    const LEAST_VOXEL: f32 = 1e-3;
    let voxel = voxel.max(LEAST_VOXEL);
    let offset = (1_i64 << (BITS - 1)) as f32;
    let mut keyed: Vec<(u64, u32)> = Vec::with_capacity(points.len());
    for (idx, point) in points.iter().enumerate().filter(|(_, point)| is_usable(**point)) {
        let cube = (*point / voxel).floor() + Vec3::splat(offset);
        let key = ((cube.z as u64) << (2 * BITS)) | ((cube.y as u64) << BITS) | cube.x as u64;
        keyed.push((key, idx as u32));
    }
    keyed.sort_unstable();
    keyed.dedup_by_key(|(key, _)| *key);
    keyed.iter().map(|(_, idx)| points[*idx as usize]).collect()
}

/// True if a point is near enough for the grid; axis by axis, since the largest element of a vector
/// may hide a NaN.
fn is_usable(point: Vec3) -> bool {
    point.abs().cmple(Vec3::splat(MAX_COORDINATE)).all()
}

impl Grid {
    fn around(points: &[Vec3]) -> Self {
        let first = points.first().copied().unwrap_or(Vec3::ZERO);
        let low = points.iter().fold(first, |low, point| low.min(*point));
        let high = points.iter().fold(first, |high, point| high.max(*point));
        let mut cell = CELL;
        loop {
            let cells = ((high - low) / cell).to_array().map(|count| count as usize + 1);
            if cells.iter().product::<usize>() <= MAX_CELLS {
                return Self { low, high, cell, cells };
            }
            cell *= 1.5;
        }
    }

    /// Cell of a point inside the box.
    fn coordinates(&self, point: Vec3) -> [usize; 3] {
        let scaled = ((point - self.low) / self.cell).to_array();
        core::array::from_fn(|axis| (scaled[axis] as usize).min(self.cells[axis] - 1))
    }

    const fn index(&self, [x, y, z]: [usize; 3]) -> usize {
        (z * self.cells[1] + y) * self.cells[0] + x
    }
}

/// The points in order of their cells, and where every cell starts.
fn sort_by_cell(points: &[Vec3], grid: &Grid) -> (Vec<Vec3>, Vec<u32>) {
    let cells: Vec<usize> =
        points.iter().map(|point| grid.index(grid.coordinates(*point))).collect();
    let mut starts = vec![0_u32; grid.cells.iter().product::<usize>() + 1];
    for &cell in &cells {
        starts[cell + 1] += 1;
    }
    for cell in 1..starts.len() {
        starts[cell] += starts[cell - 1];
    }
    let mut next = starts.clone();
    let mut sorted = vec![Vec3::ZERO; points.len()];
    for (point, &cell) in points.iter().zip(&cells) {
        sorted[next[cell] as usize] = *point;
        next[cell] += 1;
    }
    (sorted, starts)
}

/// Squared gap between every cell and the nearest cell that holds points, in cells, at most
/// [`FAR`].
///
/// The squared gap is a sum over axes, so its minimum is taken one axis after the other.
fn squared_gaps(grid: &Grid, cell_starts: &[u32]) -> Vec<u8> {
    let mut gaps: Vec<u8> =
        cell_starts.windows(2).map(|pair| if pair[0] == pair[1] { u8::MAX } else { 0 }).collect();
    let [nx, ny, nz] = grid.cells;
    for (stride, count) in [(1, nx), (nx, ny), (nx * ny, nz)] {
        gaps = spread_along(&gaps, stride, count);
    }
    for gap in &mut gaps {
        *gap = (*gap).min(FAR);
    }
    gaps
}

/// Minimum over the neighbours along one axis, whose cells lie `stride` apart, of their value plus
/// the squared gap to them.
fn spread_along(values: &[u8], stride: usize, count: usize) -> Vec<u8> {
    let mut spread = values.to_vec();
    for (from, to) in
        values.chunks_exact(stride * count).zip(spread.chunks_exact_mut(stride * count))
    {
        for distance in 1..=WINDOW.min(count - 1) {
            let squared_gap = ((distance - 1) * (distance - 1)) as u8;
            let shift = distance * stride;
            let n = from.len() - shift;
            lower(&mut to[shift..], &from[..n], squared_gap);
            lower(&mut to[..n], &from[shift..], squared_gap);
        }
    }
    spread
}

/// `to = min(to, from + add)`, element by element.
fn lower(to: &mut [u8], from: &[u8], add: u8) {
    for (to, from) in to.iter_mut().zip(from) {
        *to = (*to).min(from.saturating_add(add));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn vec3(bound: f32) -> impl Strategy<Value = Vec3> {
        [-bound..bound, -bound..bound, -bound..bound].prop_map(Vec3::from_array)
    }

    proptest! {
        #[test]
        fn queries_agree_with_brute_force(
            points in prop::collection::vec(vec3(0.4), 0..60),
            queries in prop::collection::vec((vec3(0.8), 0.0_f32..0.4), 20),
        ) {
            let cloud = PointCloud::new(&points, 0.01);
            for (center, radius) in queries {
                let nearest = points.iter().map(|point| point.distance(center)).fold(f32::INFINITY, f32::min);
                // Rounding decides a touch within a micrometre.
                prop_assume!((nearest - radius - 0.01).abs() > 1e-6);
                prop_assert_eq!(cloud.touches(center, radius), nearest < radius + 0.01);
                let found = cloud.nearest_within(center, radius + 0.01).map(|point| point.distance(center));
                prop_assert_eq!(found, (nearest < radius + 0.01).then_some(nearest));
            }
        }

        #[test]
        fn downsampling_keeps_a_point_near_every_point_and_one_for_each_cube(points in prop::collection::vec(vec3(0.05), 0..80)) {
            let kept = downsample(&points, 0.01);
            for point in &points {
                let nearest = kept.iter().map(|other| other.distance(*point)).fold(f32::INFINITY, f32::min);
                prop_assert!(nearest <= 0.01 * libm::sqrtf(3.0) + 1e-6);
            }
            let mut cubes: Vec<_> = kept.iter().map(|point| (*point / 0.01).floor().to_array().map(|c| c as i32)).collect();
            cubes.sort_unstable();
            cubes.dedup();
            prop_assert_eq!(cubes.len(), kept.len());
        }
    }

    #[test]
    fn a_cloud_of_nothing_or_of_broken_points_touches_nothing() {
        let broken = [Vec3::NAN, Vec3::new(f32::INFINITY, 0.0, 0.0), Vec3::splat(1e30)];
        for cloud in [PointCloud::new(&[], 0.01), PointCloud::new(&broken, 0.01)] {
            assert!(cloud.points().is_empty());
            assert!(!cloud.touches(Vec3::ZERO, 10.0));
        }
        assert!(downsample(&broken, 0.01).is_empty());
    }

    #[test]
    fn a_point_with_one_broken_coordinate_hides_no_other_point() {
        let along_x = |x: f32| Vec3::new(x, 0.0, 0.0);
        for broken in [
            Vec3::new(f32::NAN, 0.0, 0.0),
            Vec3::new(0.0, f32::NAN, 0.0),
            Vec3::new(0.0, 0.0, f32::NAN),
        ] {
            let points = [along_x(0.0), broken, along_x(1.0)];
            let cloud = PointCloud::new(&points, 0.01);
            assert_eq!(cloud.points(), [along_x(0.0), along_x(1.0)]);
            assert!(cloud.touches(along_x(-0.02), 0.02) && cloud.touches(along_x(1.02), 0.02));
            assert_eq!(downsample(&points, 0.01).len(), 2);
        }
    }

    #[test]
    fn cubes_of_no_side_lose_no_points() {
        let points =
            [Vec3::new(0.5, 0.0, 0.0), Vec3::new(0.51, 0.0, 0.0), Vec3::splat(MAX_COORDINATE)];
        for voxel in [1e-3, 1e-9, 0.0, -1.0, f32::NAN] {
            assert_eq!(downsample(&points, voxel), points, "{voxel}");
        }
        assert_eq!(downsample(&points, f32::INFINITY).len(), 1);
    }

    #[test]
    fn a_wide_cloud_gets_larger_cells_and_stays_exact() {
        let points: Vec<Vec3> = (0..200)
            .map(|i| Vec3::new((i * 37 % 100) as f32, (i * 61 % 100) as f32, (i % 100) as f32))
            .collect();
        let cloud = PointCloud::new(&points, 0.0);
        assert!(cloud.squared_gaps.len() <= MAX_CELLS);
        for (i, point) in points.iter().enumerate() {
            let center = *point + Vec3::new(0.3, -0.2, 0.1);
            assert!(cloud.touches(center, 0.38), "point {i}");
            assert!(!cloud.touches(center, 0.37), "point {i}");
        }
    }
}
