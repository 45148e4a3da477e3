//! Voxel grids as replay stores them.

use super::voxel::{
    OCCUPIED, VOXEL_CHANNELS, VoxelGrid, VoxelSpace, write_indices, write_occupied,
};
use glamx::Vec3;
use serde::{Deserialize, Serialize};

/// An occupied voxel in 8 bytes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CompactVoxel {
    /// Position in arrays over voxels.
    pub flat: u16,
    /// Mean position within the voxel, in 256ths of its sides, rounded down.
    pub offset: [u8; 3],
    /// Mean colour, sRGB.
    pub rgb: [u8; 3],
}

/// A voxel grid as replay stores it: the occupied voxels only, positions within 1/512 of a voxel,
/// colours within 1/255.
///
/// ```
/// use lpr_core::glamx::Vec3;
/// use lpr_core::perception::{CompactGrid, VoxelBounds, VoxelGrid, VoxelSpace};
///
/// let space = VoxelSpace::new(VoxelBounds::cube(Vec3::ZERO, 0.5), [16, 16, 16])?;
/// let grid = VoxelGrid::voxelise([(Vec3::splat(0.123), [10, 20, 30])], space);
/// let stored = CompactGrid::from(&grid);
/// assert_eq!(stored.occupied.len(), 1, "8 bytes instead of ten channels of 4096 voxels");
/// let (position, rgb) = stored.colored_points().next().unwrap();
/// assert!(position.distance(Vec3::splat(0.123)) < 1e-3 && rgb == [10, 20, 30]);
/// # Ok::<(), lpr_core::Error>(())
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct CompactGrid {
    /// The voxels.
    pub space: VoxelSpace,
    /// The occupied ones, in the order of [`CompactVoxel::flat`].
    pub occupied: Vec<CompactVoxel>,
}

impl CompactGrid {
    /// Number of features that [`Self::expand_into`] writes.
    #[must_use]
    pub fn n_features(&self) -> usize {
        VOXEL_CHANNELS * self.space.n_voxels()
    }

    /// Writes the features `[C, D, H, W]` of the grid, for instance into its place in a batch.
    ///
    /// # Panics
    ///
    /// When `features` does not have [`Self::n_features`] elements, or a stored voxel is not one of
    /// the space's.
    pub fn expand_into(&self, features: &mut [f32]) {
        assert_eq!(features.len(), self.n_features(), "room for all channels of all voxels");
        features.fill(0.0);
        write_indices(&self.space, features);
        for voxel in &self.occupied {
            let color = Vec3::from_array(voxel.rgb.map(f32::from)) * (2.0 / 255.0) - Vec3::ONE;
            write_occupied(
                features,
                self.space.n_voxels(),
                voxel.flat.into(),
                self.position(*voxel),
                color,
            );
        }
    }

    /// The grid in full.
    #[must_use]
    pub fn expand(&self) -> VoxelGrid {
        let mut features = vec![0.0; self.n_features()];
        self.expand_into(&mut features);
        VoxelGrid { space: self.space, features }
    }

    /// One point per occupied voxel, its mean position and colour: what is left of the cloud to
    /// augment and voxelise again.
    pub fn colored_points(&self) -> impl Iterator<Item = (Vec3, [u8; 3])> + '_ {
        self.occupied.iter().map(|voxel| (self.position(*voxel), voxel.rgb))
    }

    fn position(&self, voxel: CompactVoxel) -> Vec3 {
        let corner = self.space.corner(self.space.voxel_from_flat(voxel.flat.into()));
        // The middle of what rounds down to the same offset, so never on a face of the voxel.
        corner
            + self.space.voxel_size() * (Vec3::from_array(voxel.offset.map(f32::from)) + 0.5)
                / 256.0
    }
}

impl From<&VoxelGrid> for CompactGrid {
    fn from(grid: &VoxelGrid) -> Self {
        let at = |first: usize, flat: usize| {
            Vec3::from_array([0, 1, 2].map(|axis| grid.channel(first + axis)[flat]))
        };
        let compact = |flat: usize| {
            let corner = grid.space.corner(grid.space.voxel_from_flat(flat));
            let offset = (at(0, flat) - corner) / grid.space.voxel_size();
            let color = 0.5 * (at(3, flat) + Vec3::ONE);
            CompactVoxel {
                flat: flat as u16,
                offset: to_bytes(offset * 256.0),
                rgb: to_bytes(color * 255.0 + 0.5),
            }
        };
        let occupied = (0..grid.space.n_voxels())
            .filter(|&flat| grid.channel(OCCUPIED)[flat] > 0.0)
            .map(compact)
            .collect();
        Self { space: grid.space, occupied }
    }
}

/// Rounded down, limited to what a byte holds.
fn to_bytes(values: Vec3) -> [u8; 3] {
    values.to_array().map(|value| value as u8)
}

#[cfg(test)]
mod tests {
    use super::super::voxel::tests::{cloud, space};
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn a_stored_voxel_takes_eight_bytes() {
        assert_eq!(size_of::<CompactVoxel>(), 8);
    }

    proptest! {
        #[test]
        fn compact_storage_keeps_positions_and_colours(points in cloud()) {
            let grid = VoxelGrid::voxelise(points, space());
            let compact = CompactGrid::from(&grid);
            let expanded = compact.expand();
            let tolerance = space().voxel_size().max_element() / 512.0 + 1e-6;
            for channel in 0..VOXEL_CHANNELS {
                let tolerance = if channel < 3 { tolerance } else { 1.0 / 255.0 + 1e-6 };
                for (stored, original) in expanded.channel(channel).iter().zip(grid.channel(channel)) {
                    prop_assert!((stored - original).abs() <= tolerance, "channel {}: {} for {}", channel, stored, original);
                }
            }
            prop_assert_eq!(CompactGrid::from(&expanded), compact.clone(), "storing again loses nothing more");
            let again = VoxelGrid::voxelise(compact.colored_points(), space());
            prop_assert_eq!(again.channel(OCCUPIED), grid.channel(OCCUPIED), "no point changes its voxel");
        }
    }
}
