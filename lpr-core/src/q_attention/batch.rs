//! Replayed transitions made ready for an update: augmented, with labels recomputed, and voxelised.

use super::observation::{move_pose, move_proprio};
use super::{ActionCodec, NextBestPose, QAttentionSettings, QObservation, canonical_grasp};
use crate::perception::{PointTransform, Proprio, VoxelGrid, VoxelSpace};
use crate::rng::Rng;

use glamx::Vec3;
use rand::RngExt as _;

/// Draws of an augmentation that keeps the label inside, before the sample is used as it is.
const MAX_DRAWS: usize = 20;

/// One replayed transition.
#[derive(Debug, Clone, Copy)]
pub struct QSample<'a> {
    /// What was seen before the action.
    pub observation: &'a QObservation,
    /// The action: within the bounds of depth 0.
    pub action: NextBestPose,
    /// Reward, 0 or 1.
    pub reward: f32,
    /// What was seen after the action; none when the episode ended there.
    pub next: Option<&'a QObservation>,
    /// Importance weight of prioritised replay.
    pub weight: f32,
}

/// One sample as an update uses it.
#[derive(Debug, Clone)]
pub(super) struct Augmented<'a> {
    pub(super) sample: QSample<'a>,
    /// How observation, action and next observation have been moved.
    pub(super) transform: PointTransform,
    /// For each depth, what it sees and the voxel of the action in it.
    pub(super) depths: Vec<DepthLabel>,
    /// Rotation bins of the moved action.
    pub(super) rotation: [usize; 3],
}

/// Where a depth looks, and the position of the label among its voxels.
#[derive(Debug, Clone, Copy)]
pub(super) struct DepthLabel {
    pub(super) space: VoxelSpace,
    pub(super) flat: usize,
}

impl<'a> Augmented<'a> {
    /// `sample`, turned, shifted and with its cubes moved at random; none when its action lies outside the bounds.
    ///
    /// An augmentation that moves the label out of a cube is drawn again, never clamped.
    pub(super) fn draw(sample: QSample<'a>, codec: &ActionCodec, settings: &QAttentionSettings, rng: &mut Rng) -> Option<Self> {
        let about = codec.scene().bounds().min + 0.5 * codec.scene().bounds().size;
        for _ in 0..MAX_DRAWS {
            let yaw = symmetric(settings.yaw_range, rng);
            let shift = settings.shift_range.to_array().map(|range| symmetric(range, rng));
            let transform = PointTransform { yaw, shift: Vec3::from_array(shift), about };
            let jitters =
                settings.zoom_half_widths.iter().map(|half| jitter(half * settings.crop_jitter, rng)).collect::<Vec<_>>();
            if let Some(augmented) = Self::new(sample, codec, transform, &jitters) {
                return Some(augmented);
            }
        }
        let still = PointTransform { yaw: 0.0, shift: Vec3::ZERO, about };
        Self::new(sample, codec, still, &vec![Vec3::ZERO; settings.zoom_half_widths.len()])
    }

    /// `sample` moved by `transform`, the cube of each later depth moved by its `jitters` away from its label.
    fn new(sample: QSample<'a>, codec: &ActionCodec, transform: PointTransform, jitters: &[Vec3]) -> Option<Self> {
        let pose = canonical_grasp(move_pose(sample.action.pose, &transform));
        let mut depths = Vec::with_capacity(codec.n_depths());
        let mut center = Vec3::ZERO;
        for depth_idx in 0..codec.n_depths() {
            let space = codec.zoom(depth_idx, center)?;
            let voxel = space.voxel_from_point(pose.translation)?;
            center = space.point_from_voxel(voxel) + jitters.get(depth_idx).copied().unwrap_or(Vec3::ZERO);
            depths.push(DepthLabel { space, flat: space.flat_from_voxel(voxel) });
        }
        Some(Self { sample, transform, depths, rotation: codec.rotation.encode(pose.rotation) })
    }

    /// What the moved observation before the action shows in the cube of a depth.
    pub(super) fn grid(&self, depth_idx: usize) -> VoxelGrid {
        self.moved_grid(self.sample.observation, self.depths[depth_idx].space)
    }

    /// What a moved observation shows in `space`.
    pub(super) fn moved_grid(&self, observation: &QObservation, space: VoxelSpace) -> VoxelGrid {
        VoxelGrid::voxelise(self.transform.apply(observation.colored_points()), space)
    }

    /// Proprioception of a moved observation.
    pub(super) fn moved_proprio(&self, observation: &QObservation) -> Proprio {
        move_proprio(&observation.proprio, &self.transform)
    }
}

/// Uniform in `-range..=range`.
fn symmetric(range: f32, rng: &mut Rng) -> f32 {
    range * (2.0 * rng.random::<f32>() - 1.0)
}

fn jitter(range: f32, rng: &mut Rng) -> Vec3 {
    Vec3::from_array([0; 3].map(|_| symmetric(range, rng)))
}
