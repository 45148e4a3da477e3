//! Replayed transitions made ready for an update: augmented, with labels recomputed, and voxelised.

use super::action::ActionCodec;
use super::grasp::{HalfTurn, Hand};
use super::network::HandMotion;
use super::next_best_pose::NextBestPose;
use super::observation::QObservation;
use super::settings::{HandJitter, QAttentionSettings};
use crate::perception::{PointTransform, Proprio, VoxelGrid, VoxelSpace};
use crate::rng::Rng;

use glamx::Vec3;
use rand::RngExt as _;

/// Draws of an augmentation that keeps the label inside, before the sample is used as it is.
const MAX_DRAWS: usize = 20;

/// Between the cosines of half the angles of no turn and of a half turn.
const HALF_TURNED: f32 = 0.5;

/// One replayed transition.
#[derive(Debug, Clone, Copy)]
pub struct QSample<'a> {
    /// The observation before the action.
    pub observation: &'a QObservation,
    /// The action: within the bounds of depth 0.
    pub action: NextBestPose,
    /// Reward, 0 or 1.
    pub reward: f32,
    /// The observation after the action; none when the episode ended there.
    pub next: Option<&'a QObservation>,
    /// Importance weight of prioritised replay.
    pub weight: f32,
    /// True for an action to imitate: demonstrated, or of an episode that succeeded.
    pub imitated: bool,
}

/// The label of an action as one augmentation of it is learned.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AugmentedLabel {
    /// Turn of the augmentation about the vertical, radians.
    pub yaw: f32,
    /// Bins of roll, pitch and yaw.
    pub rotation: [usize; 3],
    /// True if the label is of the equivalent grasp, half a turn about the approach away.
    pub half_turned: bool,
}

/// One sample as an update uses it.
#[derive(Debug, Clone)]
pub(super) struct Augmented<'a> {
    pub(super) sample: QSample<'a>,
    /// Motion that was applied to observation, action and next observation.
    pub(super) transform: PointTransform,
    /// Motion of the hand that networks are told of: of a free one, and of one that holds something.
    hand_jitter: Option<[HandMotion; 2]>,
    /// Position of the moved action in the world, metres.
    pub(super) point: Vec3,
    /// For each depth, what it sees and the voxel of the action in it.
    pub(super) depths: Vec<DepthLabel>,
    /// Rotation bins of the moved action.
    pub(super) rotation: [usize; 3],
    /// True if they are of the other of two equivalent grasps.
    half_turned: bool,
}

/// The cube that a depth sees, and the position of the label among its voxels.
#[derive(Debug, Clone, Copy)]
pub(super) struct DepthLabel {
    pub(super) space: VoxelSpace,
    pub(super) flat: usize,
}

impl<'a> Augmented<'a> {
    /// `sample`, turned, shifted and with its cubes moved at random; none when its action lies
    /// outside the bounds.
    ///
    /// An augmentation that moves the label out of a cube is drawn again, never clamped.
    pub(super) fn draw(
        sample: QSample<'a>,
        codec: &ActionCodec,
        settings: &QAttentionSettings,
        rng: &mut Rng,
    ) -> Option<Self> {
        let about = codec.scene().bounds().min + 0.5 * codec.scene().bounds().size;
        for _ in 0..MAX_DRAWS {
            let yaw = symmetric(settings.yaw_range, rng);
            let shift = settings.shift_range.to_array().map(|range| symmetric(range, rng));
            let transform = PointTransform { yaw, shift: Vec3::from_array(shift), about };
            let jitters = settings
                .zoom_half_widths
                .iter()
                .map(|half| jitter(half * settings.crop_jitter, rng))
                .collect::<Vec<_>>();
            if let Some(augmented) =
                Self::new(sample, codec, settings.half_turn, transform, &jitters)
            {
                let hand_jitter = settings.hand_jitter.map(|HandJitter { free, held }| {
                    [free, held].map(|range| HandMotion {
                        shift: jitter(range.shift, rng),
                        turn: symmetric(range.turn, rng),
                    })
                });
                return Some(Self { hand_jitter, ..augmented });
            }
        }
        // No draw kept the label: the sample is learned as it was seen.
        let still = PointTransform { yaw: 0.0, shift: Vec3::ZERO, about };
        let centered = vec![Vec3::ZERO; settings.zoom_half_widths.len()];
        Self::new(sample, codec, settings.half_turn, still, &centered)
    }

    /// `sample` moved by `transform`, the cube of each later depth moved by its `jitters` away from
    /// its label.
    fn new(
        sample: QSample<'a>,
        codec: &ActionCodec,
        half_turn: HalfTurn,
        transform: PointTransform,
        jitters: &[Vec3],
    ) -> Option<Self> {
        // After the turn: it may make the other of two equivalent grasps the canonical one.
        let pose = transform.pose() * sample.action.pose;
        let hand = Hand::of(&moved(&transform, &sample.observation.proprio));
        let rotation = half_turn.label(pose.rotation, hand);
        let mut depths = Vec::with_capacity(codec.n_depths());
        let mut center = Vec3::ZERO;
        for depth_idx in 0..codec.n_depths() {
            let space = codec.zoom(depth_idx, center)?;
            let voxel = space.voxel_from_point(pose.translation)?;
            center = space.point_from_voxel(voxel)
                + jitters.get(depth_idx).copied().unwrap_or(Vec3::ZERO);
            depths.push(DepthLabel { space, flat: space.flat_from_voxel(voxel) });
        }
        let half_turned = rotation.dot(pose.rotation).abs() < HALF_TURNED;
        let rotation = codec.rotation.encode(rotation);
        let point = pose.translation;
        Some(Self { sample, transform, hand_jitter: None, point, depths, rotation, half_turned })
    }

    /// Its label of the rotation.
    pub(super) fn label(&self) -> AugmentedLabel {
        let Self { transform: PointTransform { yaw, .. }, rotation, half_turned, .. } = *self;
        AugmentedLabel { yaw, rotation, half_turned }
    }

    /// A moved observation, voxelised in `space`.
    pub(super) fn moved_grid(&self, observation: &QObservation, space: VoxelSpace) -> VoxelGrid {
        VoxelGrid::voxelise(self.transform.apply(observation.colored_points()), space)
    }

    /// Proprioception of a moved observation: the grip moves along; joint angles stay, and no
    /// network reads them.
    pub(super) fn moved_proprio(&self, observation: &QObservation) -> Proprio {
        moved(&self.transform, &observation.proprio)
    }

    /// From where networks are told of the hand of an observation.
    pub(super) fn hand_jitter(&self, observation: &QObservation) -> Option<HandMotion> {
        let [free, held] = self.hand_jitter?;
        Some(if observation.proprio.holds() { held } else { free })
    }
}

fn moved(transform: &PointTransform, proprio: &Proprio) -> Proprio {
    Proprio { grip: transform.pose() * proprio.grip, ..*proprio }
}

/// Uniform in `-range..=range`.
fn symmetric(range: f32, rng: &mut Rng) -> f32 {
    range * (2.0 * rng.random::<f32>() - 1.0)
}

fn jitter(range: f32, rng: &mut Rng) -> Vec3 {
    Vec3::from_array([0; 3].map(|_| symmetric(range, rng)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::perception::VoxelBounds;
    use crate::q_attention::settings::Jitter;
    use crate::q_attention::settings::tests::{test_proprio, test_settings};
    use crate::rng::{Stream, stream};
    use crate::robot::{Gripper, PANDA};

    use core::f32::consts::PI;
    use glamx::{Pose3, Quat};
    use proptest::prelude::{any, prop_assert, prop_assert_eq, proptest};

    /// A scene with one point, and a pose at that point.
    fn point_and_pose(point: [f32; 3], rotation: Quat) -> (QObservation, NextBestPose) {
        let bounds = VoxelBounds::scene(&PANDA).unwrap();
        let point = bounds.min + bounds.size * Vec3::from_array(point);
        let observation =
            QObservation::from_points([(point, [255, 0, 0])], test_proprio(), bounds, 0.01);
        let stored = observation.colored_points().next().expect("one point").0;
        (
            observation,
            NextBestPose { pose: Pose3::from_parts(stored, rotation), gripper: Gripper::Close },
        )
    }

    fn sample<'a>(observation: &'a QObservation, action: NextBestPose) -> QSample<'a> {
        QSample { observation, action, reward: 1.0, next: None, weight: 1.0, imitated: true }
    }

    proptest! {
        #[test]
        fn labels_stay_on_the_point_they_are_at(
            point in [0.001_f32..0.999, 0.001..0.999, 0.001..0.999],
            euler in [-3.1_f32..3.1, -1.5..1.5, -3.1..3.1],
            yaw_range in 0.0_f32..3.1,
            crop_jitter in 0.0_f32..0.99,
            shape in 0_usize..3,
            seed in any::<u64>(),
        ) {
            let zoom_half_widths = [vec![0.15], vec![0.1, 0.02], vec![]][shape].clone();
            let shift_range = Vec3::new(0.125, 0.125, 0.05);
            let translation_regularisation = vec![1.0; zoom_half_widths.len() + 1];
            let settings = QAttentionSettings { zoom_half_widths, translation_regularisation, yaw_range, shift_range, crop_jitter, ..test_settings() };
            let codec = ActionCodec::new(&settings, VoxelBounds::scene(&PANDA).unwrap()).expect("settings that fit together");
            let rotation = Quat::from_rotation_z(euler[2]) * Quat::from_rotation_y(euler[1]) * Quat::from_rotation_x(euler[0]);
            let (observation, action) = point_and_pose(point, rotation);
            let augmented = Augmented::draw(sample(&observation, action), &codec, &settings, &mut stream(seed, Stream::Augment, 0))
                .expect("the action is within bounds");

            prop_assert_eq!(augmented.depths.len(), codec.n_depths());
            for (depth_idx, label) in augmented.depths.iter().enumerate() {
                let grid = augmented.moved_grid(&observation, label.space);
                prop_assert!(grid.is_occupied(label.space.voxel_from_flat(label.flat)), "depth {}", depth_idx);
                if depth_idx > 0 {
                    let before = &augmented.depths[depth_idx - 1];
                    let attended = before.space.point_from_voxel(before.space.voxel_from_flat(before.flat));
                    let half_width = settings.zoom_half_widths[depth_idx - 1];
                    let center = label.space.bounds().min + Vec3::splat(half_width);
                    prop_assert!((center - attended).abs().max_element() <= crop_jitter * half_width + 1e-5);
                }
            }
            let moved = Quat::from_rotation_z(augmented.transform.yaw) * rotation;
            let label = codec.rotation.decode(augmented.rotation);
            let angle = [moved, moved * Quat::from_rotation_z(PI)].map(|moved| label.angle_between(moved));
            prop_assert!(angle[0].min(angle[1]) <= 3.0 * PI / 24.0 + 1e-3, "{:?}", angle);
            prop_assert!(augmented.transform.yaw.abs() <= yaw_range);
        }
    }

    #[test]
    fn actions_outside_are_refused() {
        let settings = test_settings();
        let codec = ActionCodec::new(&settings, VoxelBounds::scene(&PANDA).unwrap())
            .expect("settings that fit together");
        let (observation, mut action) = point_and_pose([0.5; 3], Quat::IDENTITY);
        action.pose.translation.z = 2.0;
        let none = QAttentionSettings { yaw_range: 0.0, shift_range: Vec3::ZERO, ..settings };
        assert!(
            Augmented::draw(
                sample(&observation, action),
                &codec,
                &none,
                &mut stream(0, Stream::Augment, 0)
            )
            .is_none()
        );
    }

    #[test]
    fn what_the_arm_feels_moves_with_what_it_sees() {
        let settings = test_settings();
        let codec = ActionCodec::new(&settings, VoxelBounds::scene(&PANDA).unwrap())
            .expect("settings that fit together");
        let (observation, action) = point_and_pose([0.4, 0.6, 0.3], Quat::from_rotation_x(PI));
        let augmented = Augmented::draw(
            sample(&observation, action),
            &codec,
            &settings,
            &mut stream(1, Stream::Augment, 0),
        )
        .expect("the action is within bounds");
        let seen_from_grip = observation.proprio.grip.inverse() * action.pose.translation;
        let moved = augmented.transform.pose() * action.pose.translation;
        let moved_seen = augmented.moved_proprio(&observation).grip.inverse() * moved;
        assert!(augmented.transform.yaw.abs() > 1e-3);
        assert!((seen_from_grip - moved_seen).length() < 1e-5);
    }

    #[test]
    fn the_hand_is_told_from_elsewhere_a_free_one_and_one_that_holds_something_each_in_its_range() {
        let free = Jitter { shift: 0.1, turn: 0.8 };
        let held = Jitter { shift: 0.01, turn: 0.1 };
        let hand_jitter = Some(HandJitter { free, held });
        let settings = QAttentionSettings { hand_jitter, ..test_settings() };
        let codec = ActionCodec::new(&settings, VoxelBounds::scene(&PANDA).unwrap())
            .expect("settings that fit together");
        let (observation, action) = point_and_pose([0.4, 0.6, 0.3], Quat::from_rotation_x(PI));
        let mut holding = observation.clone();
        holding.proprio.gripper_open = 0.0;
        holding.proprio.gripper_width = 0.03;
        for (observation, range) in [(&observation, free), (&holding, held)] {
            let (mut farthest, mut most) = (0.0_f32, 0.0_f32);
            for seed in 0..50 {
                let rng = &mut stream(seed, Stream::Augment, 0);
                let augmented =
                    Augmented::draw(sample(observation, action), &codec, &settings, rng)
                        .expect("the action is within bounds");
                let HandMotion { shift, turn } =
                    augmented.hand_jitter(observation).expect("there is a range");
                (farthest, most) = (farthest.max(shift.abs().max_element()), most.max(turn.abs()));
            }
            assert!((0.9..=1.001).contains(&(farthest / range.shift)), "{farthest} m");
            assert!((0.9..=1.001).contains(&(most / range.turn)), "{most} rad");
        }
    }
}
