//! Between the voxels of a grid and the points of its space.
//!
//! A voxel of the last depth is two centimetres wide in the presets, as wide as what grasps forgive.
//! With [`Position::Interpolated`](super::Position::Interpolated) its neighbours say where in it the point lies: an imitated point
//! is spread over the eight voxels whose centres surround it, each with its trilinear weight, whose
//! mean position is the point; the agent goes to the mean position around its best voxel under
//! `softmax(Q / T)`, which imitation fits to those weights.
//!
//! # Differences from the paper
//!
//! The paper's agent goes to the centre of its best voxel: [`Position::Voxel`](super::Position::Voxel).

use crate::perception::{VoxelIndex, VoxelSpace};

use glamx::Vec3;

/// Voxels whose centres surround a point.
pub(super) const SURROUNDING: usize = 8;

/// The voxels around `point`, flat, with their trilinear weights, which sum to 1; beyond the outer
/// centres those of the outer voxels alone.
pub(super) fn surrounding(space: &VoxelSpace, point: Vec3) -> [(usize, f32); SURROUNDING] {
    let counts = space.voxels_per_side();
    let from_first = (point - space.bounds().min) / space.voxel_size() - Vec3::splat(0.5);
    let axes = [0, 1, 2].map(|axis| {
        let last = counts[axis] - 1;
        let at = from_first[axis].clamp(0.0, last as f32);
        let below = (at as usize).min(last);
        [(below, 1.0 - (at - below as f32)), ((below + 1).min(last), at - below as f32)]
    });
    core::array::from_fn(|corner| {
        let [(x, wx), (y, wy), (z, wz)] = [0, 1, 2].map(|axis| axes[axis][corner >> axis & 1]);
        (space.flat_from_voxel(VoxelIndex { x, y, z }), wx * wy * wz)
    })
}

/// Mean position over `best` and its neighbours under `softmax(values / temperature)`.
pub(super) fn mean_around(
    space: &VoxelSpace,
    values: &[f32],
    best: VoxelIndex,
    temperature: f32,
) -> Vec3 {
    let counts = space.voxels_per_side();
    let near = |at: usize, axis: usize| at.saturating_sub(1)..=(at + 1).min(counts[axis] - 1);
    let highest = values[space.flat_from_voxel(best)];
    let (mut mean, mut total) = (Vec3::ZERO, 0.0);
    for z in near(best.z, 2) {
        for y in near(best.y, 1) {
            for x in near(best.x, 0) {
                let voxel = VoxelIndex { x, y, z };
                let value = values[space.flat_from_voxel(voxel)];
                let weight = libm::expf((value - highest) / temperature);
                mean += weight * space.point_from_voxel(voxel);
                total += weight;
            }
        }
    }
    mean / total
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::perception::VoxelBounds;
    use proptest::prelude::{prop_assert, proptest};

    fn space() -> VoxelSpace {
        VoxelSpace::new(VoxelBounds::cube(Vec3::new(0.4, -0.1, 0.2), 0.15), [16, 12, 8])
            .expect("a volume")
    }

    proptest! {
        #[test]
        fn the_mean_of_the_voxels_around_a_point_is_the_point(at in [0.07_f32..0.93, 0.07..0.93, 0.07..0.93]) {
            let space = space();
            let point = space.bounds().min + space.bounds().size * Vec3::from_array(at);
            let around = surrounding(&space, point);
            let mean: Vec3 = around.iter().map(|&(flat, weight)| weight * space.point_from_voxel(space.voxel_from_flat(flat))).sum();
            prop_assert!(mean.distance(point) < 1e-5, "{mean} for {point}");
            prop_assert!((around.iter().map(|(_, weight)| weight).sum::<f32>() - 1.0).abs() < 1e-5);

            // Values whose softmax are those weights: the agent goes to the point.
            let mut values = vec![-10.0; 16 * 12 * 8];
            for (flat, weight) in around {
                values[flat] = 0.1 * weight.max(1e-6).ln();
            }
            let best = (0..values.len()).max_by(|&a, &b| values[a].total_cmp(&values[b])).expect("voxels");
            let found = mean_around(&space, &values, space.voxel_from_flat(best), 0.1);
            prop_assert!(found.distance(point) < 1e-4, "{found} for {point}");
        }

        #[test]
        fn a_point_near_or_beyond_the_border_has_neighbours_inside(at in [-0.1_f32..1.1, -0.1..1.1, -0.1..1.1]) {
            let space = space();
            let around = surrounding(&space, space.bounds().min + space.bounds().size * Vec3::from_array(at));
            prop_assert!(around.iter().all(|&(flat, weight)| flat < 16 * 12 * 8 && weight >= 0.0));
            prop_assert!((around.iter().map(|(_, weight)| weight).sum::<f32>() - 1.0).abs() < 1e-5);
        }
    }
}
