//! The part of an observation that the replay keeps: enough to voxelise it again at any depth, turned and
//! shifted.

use crate::perception::{Observation, Proprio, VoxelBounds};

use glamx::Vec3;

/// Largest value of a quantised coordinate.
const STEPS: f32 = u16::MAX as f32;

/// A point and its colour in 10 bytes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct StoredPoint {
    /// Position within the bounds of the cloud, in 65535ths of their sides (0.015 mm a metre).
    pub position: [u16; 3],
    /// Colour, sRGB.
    pub rgb: [u8; 3],
}

/// A thinned point cloud and proprioception: 10 bytes a point, so some 60 kB for the 6,000 points
/// of a tabletop at 1 cm.
///
/// Images of 128 x 128 with colour and points, as the released code stores, take 246 kB.
#[derive(Debug, Clone, PartialEq)]
pub struct QObservation {
    /// The box whose points are kept.
    pub bounds: VoxelBounds,
    /// At most one point per cell of the thinning grid, in the order of the cells that `cloud` was
    /// met in.
    pub points: Vec<StoredPoint>,
    /// The arm's measurement of itself.
    pub proprio: Proprio,
}

impl QObservation {
    /// The points of `observation` within `bounds`, at most one per cube of side `spacing`, metres.
    ///
    /// The first point of a cell stays: with cells finer than the finest voxels, means of voxels
    /// hardly change.
    ///
    /// # Panics
    ///
    /// When `spacing` is not a positive length.
    #[must_use]
    pub fn new(observation: &Observation, bounds: VoxelBounds, spacing: f32) -> Self {
        Self::from_points(observation.colored_points(), observation.proprio, bounds, spacing)
    }

    /// [`Self::new`] from a point cloud.
    ///
    /// # Panics
    ///
    /// When `spacing` is not a positive length.
    #[must_use]
    pub fn from_points(
        cloud: impl IntoIterator<Item = (Vec3, [u8; 3])>,
        proprio: Proprio,
        bounds: VoxelBounds,
        spacing: f32,
    ) -> Self {
        assert!(spacing > 0.0, "points are thinned to a positive spacing, got {spacing}");
        let n_cells =
            (bounds.size / spacing).to_array().map(|cells| (cells.ceil() as usize).max(1));
        let mut taken = vec![false; n_cells.iter().product()];
        let mut points = Vec::new();
        for (point, rgb) in cloud {
            if !bounds.contains(point) {
                continue;
            }
            let cell = ((point - bounds.min) / spacing).to_array();
            let [x, y, z] = [0, 1, 2].map(|axis| (cell[axis] as usize).min(n_cells[axis] - 1));
            let taken = &mut taken[(z * n_cells[1] + y) * n_cells[0] + x];
            if !*taken {
                *taken = true;
                let steps = (point - bounds.min) / bounds.size * STEPS + 0.5;
                points
                    .push(StoredPoint { position: steps.to_array().map(|step| step as u16), rgb });
            }
        }
        points.shrink_to_fit();
        Self { bounds, points, proprio }
    }

    /// The points, metres in the world, with their colours.
    pub fn colored_points(&self) -> impl Iterator<Item = (Vec3, [u8; 3])> + '_ {
        let step = self.bounds.size / STEPS;
        self.points.iter().map(move |point| {
            (self.bounds.min + step * Vec3::from_array(point.position.map(f32::from)), point.rgb)
        })
    }

    /// Bytes in memory.
    #[must_use]
    pub fn n_bytes(&self) -> usize {
        size_of::<Self>() + self.points.capacity() * size_of::<StoredPoint>()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::q_attention::settings::tests::test_proprio;
    use crate::robot::PANDA;
    use proptest::prelude::{any, prop, prop_assert, prop_assert_eq, proptest};

    proptest! {
        #[test]
        fn points_keep_place_and_colour_and_one_stays_per_cell(
            cloud in prop::collection::vec(([-0.2_f32..1.2, -0.6..0.6, -0.2..0.9], any::<[u8; 3]>()), 0..400),
        ) {
            let cloud: Vec<_> = cloud.into_iter().map(|(point, rgb)| (Vec3::from_array(point), rgb)).collect();
            let bounds = VoxelBounds::scene(&PANDA).unwrap();
            let stored = QObservation::from_points(cloud.iter().copied(), test_proprio(), bounds, 0.1);
            let mut inside = cloud.iter().filter(|(point, _)| bounds.contains(*point));
            prop_assert!(stored.points.len() <= 1000);
            for (point, rgb) in stored.colored_points() {
                // Order is kept, so each stored point is found after the one before it.
                let original = inside.find(|(other, _)| (*other - point).abs().max_element() < 1e-5);
                prop_assert_eq!(original.map(|(_, rgb)| *rgb), Some(rgb));
            }
            let cell = |point: Vec3| ((point - bounds.min) / 0.1).floor();
            for (point, _) in cloud.iter().filter(|(point, _)| bounds.contains(*point)) {
                let near = |other: Vec3| (cell(other) - cell(*point)).abs().max_element() <= 1.0;
                prop_assert!(stored.colored_points().any(|(other, _)| near(other)));
            }
        }
    }
}
