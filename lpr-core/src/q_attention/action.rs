//! The discrete action: what Q-attention chooses among, and the pose it stands for.
//!
//! A translation is one voxel per depth, each in the cube around the one before. A rotation is
//! three bins of extrinsic x-y-z Euler angles (roll about the world's x first, then pitch about y,
//! then yaw about z), `rotation_bins` of them around the circle.
//!
//! # Singularity
//!
//! At a pitch of ±90° (the grip's x axis vertical) roll and yaw turn about the same line.
//! [`RotationCodec::encode`] then puts the whole turn into yaw, so that one orientation has one
//! label; near that pitch, labels of neighbouring orientations can still be far apart, though each
//! decodes to the right orientation. A grip that points down or along the table with its x axis
//! level is far from it.

use super::next_best_pose::NextBestPose;
use super::settings::QAttentionSettings;
use crate::error::Result;
use crate::perception::{VoxelBounds, VoxelIndex, VoxelSpace};
use crate::robot::Gripper;

use core::f32::consts::PI;
use glamx::{Mat3, Pose3, Quat, Vec3};

/// One choice of every discrete part of a next-best pose.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct DiscreteAction {
    /// The voxel at each depth, in the cube of that depth.
    pub voxels: Vec<VoxelIndex>,
    /// Bins of roll, pitch and yaw.
    pub rotation: [usize; 3],
    /// The gripper command.
    pub gripper: Gripper,
}

/// Between next-best poses and discrete actions.
#[derive(Debug, Clone, PartialEq)]
pub struct ActionCodec {
    scene: VoxelSpace,
    zoom_half_widths: Vec<f32>,
    /// The code of orientations.
    pub rotation: RotationCodec,
}

impl ActionCodec {
    /// The code of actions within `bounds`, which depth 0 covers.
    ///
    /// # Errors
    ///
    /// When the settings do not fit together, or `bounds` has no volume.
    pub fn new(settings: &QAttentionSettings, bounds: VoxelBounds) -> Result<Self> {
        settings.check()?;
        Ok(Self {
            scene: VoxelSpace::new(bounds, [settings.voxels_per_side; 3])?,
            zoom_half_widths: settings.zoom_half_widths.clone(),
            rotation: RotationCodec { n_bins: settings.rotation_bins },
        })
    }

    /// The action whose voxels hold `goal` at every depth, or none when `goal` lies outside the
    /// bounds.
    ///
    /// Never clamped: a clamped label would be a wrong one.
    #[must_use]
    pub fn encode(&self, goal: &NextBestPose) -> Option<DiscreteAction> {
        let mut voxels = Vec::with_capacity(self.n_depths());
        let mut space = self.scene;
        loop {
            let voxel = space.voxel_from_point(goal.pose.translation)?;
            voxels.push(voxel);
            let Some(next) = self.zoom(voxels.len(), space.point_from_voxel(voxel)) else { break };
            space = next;
        }
        Some(DiscreteAction {
            voxels,
            rotation: self.rotation.encode(goal.pose.rotation),
            gripper: goal.gripper,
        })
    }

    /// The pose that an action stands for: the centre of its last voxel and of its rotation bins.
    ///
    /// # Panics
    ///
    /// When the action does not have one voxel per depth.
    #[must_use]
    pub fn decode(&self, action: &DiscreteAction) -> NextBestPose {
        assert_eq!(action.voxels.len(), self.n_depths(), "one voxel per depth");
        let translation =
            action.voxels.iter().enumerate().fold(Vec3::ZERO, |center, (depth_idx, &voxel)| {
                self.zoom(depth_idx, center)
                    .expect("there is a space for each depth")
                    .point_from_voxel(voxel)
            });
        let pose = Pose3::from_parts(translation, self.rotation.decode(action.rotation));
        NextBestPose { pose, gripper: action.gripper }
    }

    /// The nearest pose that the agent could choose, or none when `goal` lies outside the bounds.
    #[must_use]
    pub fn quantise(&self, goal: &NextBestPose) -> Option<NextBestPose> {
        self.encode(goal).map(|action| self.decode(&action))
    }

    /// Number of depths.
    #[must_use]
    pub fn n_depths(&self) -> usize {
        self.zoom_half_widths.len() + 1
    }

    /// The space of depth 0.
    #[must_use]
    pub fn scene(&self) -> &VoxelSpace {
        &self.scene
    }

    /// The space of depth `depth_idx` when the depth before attends to `center`; none when there is
    /// no such depth.
    #[must_use]
    pub fn zoom(&self, depth_idx: usize, center: Vec3) -> Option<VoxelSpace> {
        if depth_idx == 0 {
            return Some(self.scene);
        }
        let half_width = *self.zoom_half_widths.get(depth_idx - 1)?;
        let space =
            VoxelSpace::new(VoxelBounds::cube(center, half_width), self.scene.voxels_per_side());
        Some(space.expect("half widths are positive and counts those of the scene"))
    }
}

/// Between orientations and bins of Euler angles.
///
/// ```
/// use lpr_core::glamx::Quat;
/// use lpr_core::q_attention::RotationCodec;
///
/// let codec = RotationCodec { n_bins: 72 };
/// let pointing_down = Quat::from_rotation_x(core::f32::consts::PI);
/// let bins = codec.encode(pointing_down);
/// assert_eq!(bins, [0, 36, 36], "±180°, 0° and 0°");
/// assert!(codec.decode(bins).angle_between(pointing_down) < 1e-3);
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct RotationCodec {
    /// Bins of each angle over the full circle, a multiple of 4; bin 0 is centred on -180°.
    pub n_bins: usize,
}

impl RotationCodec {
    /// The bins of roll, pitch and yaw; pitch always within ±90°.
    ///
    /// Decoding them gives an orientation within one and a half bins (7.5° with 72 bins): at most
    /// half a bin a rotation, and `R = Rz Ry Rx` adds up no more than the three.
    #[must_use]
    pub fn encode(self, rotation: Quat) -> [usize; 3] {
        let m = Mat3::from_quat(rotation.normalize());
        let [x, y, z] = [m.x_axis, m.y_axis, m.z_axis];
        let pitch = self.bin(libm::atan2f(-x.z, libm::hypotf(x.x, x.y)));
        let right_angle = self.n_bins / 4;
        if pitch == right_angle || pitch == 3 * right_angle {
            // Roll and yaw turn about one line: with no roll, y stays level and shows the turn.
            return [self.bin(0.0), pitch, self.bin(libm::atan2f(-y.x, y.y))];
        }
        [self.bin(libm::atan2f(y.z, z.z)), pitch, self.bin(libm::atan2f(x.y, x.x))]
    }

    /// The orientation at the centres of the bins, with w >= 0.
    #[must_use]
    pub fn decode(self, bins: [usize; 3]) -> Quat {
        let [roll, pitch, yaw] = bins.map(|bin| self.angle(bin));
        canonical(
            Quat::from_rotation_z(yaw) * Quat::from_rotation_y(pitch) * Quat::from_rotation_x(roll),
        )
    }

    /// Centre of a bin, radians in -π..π.
    #[must_use]
    pub fn angle(self, bin: usize) -> f32 {
        2.0 * PI * bin as f32 / self.n_bins as f32 - PI
    }

    /// The bin nearest to `angle`, radians; the last half bin before +180° is bin 0.
    #[must_use]
    pub fn bin(self, angle: f32) -> usize {
        let bins = (angle + PI) / (2.0 * PI) * self.n_bins as f32;
        (libm::roundf(bins) as i64).rem_euclid(self.n_bins as i64) as usize
    }
}

/// The quaternion of the same orientation with w >= 0.
#[must_use]
pub fn canonical(rotation: Quat) -> Quat {
    if rotation.w < 0.0 { -rotation } else { rotation }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::q_attention::settings::tests::test_settings;
    use crate::robot::PANDA;
    use proptest::prelude::{Strategy, any, prop_assert, prop_assert_eq, proptest};

    fn codec(
        voxels_per_side: usize,
        rotation_bins: usize,
        zoom_half_widths: &[f32],
    ) -> ActionCodec {
        let zoom_half_widths = zoom_half_widths.to_vec();
        let translation_regularisation = vec![1.0; zoom_half_widths.len() + 1];
        let settings = QAttentionSettings {
            voxels_per_side,
            rotation_bins,
            zoom_half_widths,
            translation_regularisation,
            ..test_settings()
        };
        ActionCodec::new(&settings, VoxelBounds::scene(&PANDA).unwrap())
            .expect("settings that fit together")
    }

    fn rotations() -> impl Strategy<Value = Quat> {
        [-1.0_f32..1.0, -1.0..1.0, -1.0..1.0, -1.0..1.0]
            .prop_filter("too short to normalise", |q| q.iter().map(|v| v * v).sum::<f32>() > 1e-2)
            .prop_map(|q| Quat::from_array(q).normalize())
    }

    fn goals() -> impl Strategy<Value = NextBestPose> {
        let positions = [-0.029_f32..0.969, -0.499..0.499, -0.149..0.849];
        (positions, rotations(), any::<bool>()).prop_map(|(position, rotation, open)| {
            NextBestPose {
                pose: Pose3::from_parts(Vec3::from_array(position), rotation),
                gripper: if open { Gripper::Open } else { Gripper::Close },
            }
        })
    }

    fn angle_between(a: Quat, b: Quat) -> f32 {
        2.0 * (a.inverse() * b).xyz().length().min(1.0).asin()
    }

    proptest! {
        #[test]
        fn decoding_stays_within_half_a_voxel_and_one_and_a_half_bins(goal in goals(), sizes in 0_usize..4) {
            let (side, bins, half) = [(16, 72, &[0.15][..]), (16, 72, &[0.1]), (12, 36, &[0.15, 0.03]), (8, 120, &[])][sizes];
            let codec = codec(side, bins, half);
            let near = codec.quantise(&goal).expect("inside the bounds");
            let half_voxel = half.last().map_or(0.5, |half| *half) / side as f32;
            let offset = (near.pose.translation - goal.pose.translation).abs();
            prop_assert!(offset.max_element() <= half_voxel + 1e-6, "{offset} over {half_voxel}");
            let bound = 1.5 * 2.0 * PI / bins as f32;
            let angle = angle_between(near.pose.rotation, goal.pose.rotation);
            prop_assert!(angle <= bound + 1e-3, "{angle} over {bound}");
            prop_assert!(near.pose.rotation.w >= 0.0);
            prop_assert_eq!(near.gripper, goal.gripper);
        }

        #[test]
        fn a_chosen_pose_is_its_own_label(goal in goals()) {
            let codec = codec(16, 72, &[0.15]);
            let action = codec.encode(&goal).expect("inside the bounds");
            prop_assert_eq!(codec.encode(&codec.decode(&action)), Some(action));
        }

        #[test]
        fn goals_outside_are_refused(goal in goals(), axis in 0_usize..3, out in 1e-4_f32..1.0, above in any::<bool>()) {
            let codec = codec(16, 72, &[0.15]);
            let mut goal = goal;
            let bounds = codec.scene().bounds();
            let (min, max) = (bounds.min[axis], bounds.max()[axis]);
            goal.pose.translation[axis] = if above { max + out } else { min - out };
            prop_assert_eq!(codec.encode(&goal), None);
        }
    }

    #[test]
    fn every_rotation_bin_round_trips() {
        for n_bins in [72, 24] {
            let codec = RotationCodec { n_bins };
            let quarter = n_bins / 4;
            for roll in 0..n_bins {
                for pitch in quarter + 1..3 * quarter {
                    for yaw in [0, 1, quarter, n_bins - 1] {
                        assert_eq!(
                            codec.encode(codec.decode([roll, pitch, yaw])),
                            [roll, pitch, yaw]
                        );
                        assert_eq!(
                            codec.encode(codec.decode([yaw, pitch, roll])),
                            [yaw, pitch, roll]
                        );
                    }
                }
            }
        }
    }

    #[test]
    fn bins_over_the_top_and_at_the_singularity_keep_their_orientation() {
        let codec = RotationCodec { n_bins: 72 };
        for roll in (0..72).step_by(5) {
            for pitch in (0..=18).chain(54..72) {
                let rotation = codec.decode([roll, pitch, 31]);
                let again = codec.encode(rotation);
                assert!((18..=54).contains(&again[1]));
                assert!(
                    angle_between(codec.decode(again), rotation) < 1e-3,
                    "{roll} {pitch} became {again:?}"
                );
            }
        }
    }

    #[test]
    fn euler_angles_are_extrinsic_roll_pitch_yaw() {
        let codec = RotationCodec { n_bins: 72 };
        // Roll 180°, pitch 0, yaw 90°: a gripper that points down, its x axis along the world's y.
        let down = codec.decode([0, 36, 54]);
        assert!((down * Vec3::Z - Vec3::NEG_Z).length() < 1e-6);
        assert!((down * Vec3::X - Vec3::Y).length() < 1e-6);
    }

    #[test]
    fn every_voxel_of_the_last_depth_is_its_own_label() {
        let codec = codec(8, 72, &[0.15]);
        let far = VoxelIndex { x: 2, y: 0, z: 7 };
        let cube = codec.zoom(1, codec.scene().point_from_voxel(far)).expect("two depths");
        for near in (0..512).map(|flat| cube.voxel_from_flat(flat)) {
            let action = DiscreteAction {
                voxels: vec![far, near],
                rotation: [0, 36, 7],
                gripper: Gripper::Close,
            };
            let center = codec.decode(&action).pose.translation;
            assert_eq!(cube.voxel_from_point(center), Some(near));
        }
        assert!(codec.zoom(2, Vec3::ZERO).is_none());
    }
}
