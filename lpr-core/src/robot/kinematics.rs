//! Forward kinematics and the Jacobian: pure functions of a configuration.
//!
//! Trigonometry goes through `libm` and nothing is fused, so that native code and wasm agree bit
//! for bit.

use super::{DOF, Error, HAND, JointConfig, N_LINKS, ROBOTS, Result, Robot};
use core::f64::consts::{FRAC_1_SQRT_2, FRAC_PI_2};
use glamx::{DPose3, DQuat, DVec3, Pose3};

impl Robot {
    /// The built-in robot of that name.
    ///
    /// ```
    /// use lpr_core::robot::Robot;
    ///
    /// assert_eq!(Robot::by_name("panda")?.gripper.max_width, 0.08);
    /// assert_eq!(Robot::by_name("ur5").unwrap_err().to_string(), "robot: unknown robot 'ur5', known: xarm7, panda");
    /// # Ok::<(), lpr_core::Error>(())
    /// ```
    ///
    /// # Errors
    ///
    /// When there is none, naming those that exist.
    pub fn by_name(name: &str) -> Result<&'static Self> {
        ROBOTS.into_iter().find(|robot| robot.name == name).ok_or_else(|| {
            let known: Vec<_> = ROBOTS.iter().map(|robot| robot.name).collect();
            Error::Robot(format!("unknown robot '{name}', known: {}", known.join(", ")))
        })
    }

    /// Whether every joint is within its limits.
    ///
    /// ```
    /// use lpr_core::robot::PANDA;
    ///
    /// let mut config = PANDA.start;
    /// config[3] = PANDA.joints[3].upper;
    /// assert!(PANDA.within_limits(&config), "limits belong to the range");
    /// config[3] += 1e-3;
    /// assert!(!PANDA.within_limits(&config));
    /// config[3] = f32::NAN;
    /// assert!(!PANDA.within_limits(&config));
    /// ```
    #[must_use]
    pub fn within_limits(&self, config: &JointConfig) -> bool {
        self.joints
            .iter()
            .zip(config.iter())
            .all(|(joint, &q)| joint.lower <= q && q <= joint.upper)
    }

    /// `world_from_joint` of the seven joint frames in f64.
    ///
    /// Every joint turns about the z axis of its frame:
    ///
    /// ```
    /// use lpr_core::glamx::DVec3;
    /// use lpr_core::robot::XARM7;
    ///
    /// let [shoulder, ..] = XARM7.joint_frames(&XARM7.start);
    /// assert_eq!(shoulder.translation, DVec3::new(0.0, 0.0, 0.267), "metres above the base");
    /// assert!((shoulder.rotation * DVec3::Z).distance(DVec3::Z) < 1e-12);
    /// ```
    #[must_use]
    pub fn joint_frames(&self, config: &JointConfig) -> [DPose3; DOF] {
        self.frames_at(&config.to_array::<DOF>().map(f64::from))
    }

    /// `world_from_joint` at f64 angles.
    pub(super) fn frames_at(&self, angles: &[f64; DOF]) -> [DPose3; DOF] {
        let mut world_from_joint = DPose3::IDENTITY;
        core::array::from_fn(|j| {
            world_from_joint *= self.joints[j].transform(angles[j]);
            world_from_joint
        })
    }

    /// `world_from_frame` of base, links 1–7 and hand (the flange).
    ///
    /// ```
    /// use lpr_core::glamx::{Pose3, Vec3};
    /// use lpr_core::robot::{HAND, XARM7};
    ///
    /// let world_from_link = XARM7.link_frames(&XARM7.start);
    /// assert_eq!(world_from_link[0], Pose3::IDENTITY, "the base is the world");
    /// assert_eq!(world_from_link[HAND], Pose3::from(XARM7.flange(&XARM7.start)));
    /// // A point 0.172 m ahead of the flange is between the finger pads.
    /// assert!((world_from_link[HAND] * Vec3::new(0.0, 0.0, 0.172)).distance(XARM7.grip(&XARM7.start).translation) < 1e-5);
    /// ```
    #[must_use]
    pub fn link_frames(&self, config: &JointConfig) -> [Pose3; N_LINKS] {
        self.link_frames_and_grip(config).0
    }

    /// [`Self::link_frames`] and [`Self::grip`] together: both follow from the joints' frames.
    #[must_use]
    pub fn link_frames_and_grip(&self, config: &JointConfig) -> ([Pose3; N_LINKS], Pose3) {
        let joint_frames = self.joint_frames(config);
        let flange = joint_frames[DOF - 1] * self.link7_from_flange;
        let frames = core::array::from_fn(|frame| match frame {
            0 => Pose3::IDENTITY,
            HAND => Pose3::from(flange),
            link => Pose3::from(joint_frames[link - 1]),
        });
        (frames, Pose3::from(flange * self.flange_from_grip))
    }

    /// `world_from_flange` in f64.
    ///
    /// ```
    /// use lpr_core::glamx::DVec3;
    /// use lpr_core::robot::PANDA;
    ///
    /// // The last joint turns the flange about its own z axis.
    /// let mut turned = PANDA.start;
    /// turned[6] += 0.5;
    /// let (before, after) = (PANDA.flange(&PANDA.start), PANDA.flange(&turned));
    /// assert!((before.rotation * DVec3::Z).distance(after.rotation * DVec3::Z) < 1e-12);
    /// assert!(before.translation.distance(after.translation) < 1e-12);
    /// ```
    #[must_use]
    pub fn flange(&self, config: &JointConfig) -> DPose3 {
        self.joint_frames(config)[DOF - 1] * self.link7_from_flange
    }

    /// `world_from_grip` in f64.
    #[must_use]
    pub fn grip_f64(&self, config: &JointConfig) -> DPose3 {
        self.flange(config) * self.flange_from_grip
    }

    /// `world_from_grip`: the frame between the finger pads, z approach, y opening.
    ///
    /// ```
    /// use lpr_core::glamx::Vec3;
    /// use lpr_core::robot::XARM7;
    ///
    /// let world_from_grip = XARM7.grip(&XARM7.start);
    /// let ahead = world_from_grip * Vec3::new(0.0, 0.0, 0.1);
    /// assert!((world_from_grip.translation.z - ahead.z - 0.1).abs() < 1e-3, "the start looks down on the table");
    /// ```
    #[must_use]
    pub fn grip(&self, config: &JointConfig) -> Pose3 {
        Pose3::from(self.grip_f64(config))
    }

    /// Jacobian of the grip in the world frame: rows are linear velocity (m/rad) then angular
    /// velocity (rad/rad).
    ///
    /// ```
    /// use lpr_core::robot::XARM7;
    ///
    /// let jacobian = XARM7.jacobian(&XARM7.start);
    /// let mut turned = XARM7.start;
    /// turned[0] += 1e-3;
    /// let moved = XARM7.grip_f64(&turned).translation - XARM7.grip_f64(&XARM7.start).translation;
    /// assert!((moved.y / 1e-3 - jacobian[1][0]).abs() < 1e-3, "metres per radian of the first joint");
    /// assert_eq!(jacobian[5][0], 1.0, "which turns about the vertical");
    /// ```
    #[must_use]
    pub fn jacobian(&self, config: &JointConfig) -> [[f64; DOF]; 6] {
        self.jacobian_of(&self.joint_frames(config))
    }

    /// The Jacobian, from the frames of the joints.
    pub(super) fn jacobian_of(&self, frames: &[DPose3; DOF]) -> [[f64; DOF]; 6] {
        let grip = (frames[DOF - 1] * self.link7_from_flange * self.flange_from_grip).translation;
        let mut jacobian = [[0.0; DOF]; 6];
        for (j, frame) in frames.iter().enumerate() {
            let axis = frame.rotation * DVec3::Z;
            let linear = axis.cross(grip - frame.translation);
            for (row, value) in linear.to_array().into_iter().chain(axis.to_array()).enumerate() {
                jacobian[row][j] = value;
            }
        }
        jacobian
    }
}

impl super::Joint {
    /// `parent_from_joint` at angle `q`: `Rx(alpha) Tx(a) Rz(q) Tz(d)`.
    ///
    /// ```
    /// use core::f64::consts::FRAC_PI_2;
    /// use lpr_core::glamx::DVec3;
    /// use lpr_core::robot::PANDA;
    ///
    /// // The fourth joint is 0.0825 m along the x axis of the third's frame, wherever it turns to.
    /// let parent_from_joint = PANDA.joints[3].transform(FRAC_PI_2);
    /// assert_eq!(parent_from_joint.translation, DVec3::new(0.0825, 0.0, 0.0));
    /// ```
    #[must_use]
    pub fn transform(&self, q: f64) -> DPose3 {
        let [(sin_x, cos_x), (sin_alpha, cos_alpha)] = sincos_of_twist(self.alpha);
        let (sin_z, cos_z) = libm::sincos(0.5 * q);
        DPose3::from_parts(
            DVec3::new(self.a, -sin_alpha * self.d, cos_alpha * self.d),
            DQuat::from_xyzw(sin_x * cos_z, -sin_x * sin_z, cos_x * sin_z, cos_x * cos_z),
        )
    }
}

/// Sine and cosine of half the twist and of the twist.
///
/// Those of right angles, which most joints have, are written down: they would be two thirds of the
/// trigonometry of an arm.
fn sincos_of_twist(alpha: f64) -> [(f64, f64); 2] {
    /// One unit in the last place below the cosine.
    const SIN_45: f64 = 0.707_106_781_186_547_5;
    const COS_90: f64 = 6.123_233_995_736_766e-17;
    if alpha == 0.0 {
        [(0.0, 1.0); 2]
    } else if alpha.abs() == FRAC_PI_2 {
        [(SIN_45.copysign(alpha), FRAC_1_SQRT_2), (1.0_f64.copysign(alpha), COS_90)]
    } else {
        [libm::sincos(0.5 * alpha), libm::sincos(alpha)]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rng::{Stream, stream};
    use rand::RngExt as _;

    #[test]
    fn jacobian_agrees_with_finite_differences() {
        let mut rng = stream(1, Stream::Ik, 0);
        for robot in ROBOTS {
            for _ in 0..50 {
                let config = JointConfig::new(
                    robot.joints.map(|joint| rng.random_range(joint.lower..joint.upper)),
                );
                let jacobian = robot.jacobian(&config);
                for j in 0..DOF {
                    let moved = |by: f64| {
                        let mut angles = config.to_array::<DOF>().map(f64::from);
                        angles[j] += by;
                        robot.frames_at(&angles)[DOF - 1]
                            * robot.link7_from_flange
                            * robot.flange_from_grip
                    };
                    let (before, after) = (moved(-1e-5), moved(1e-5));
                    let linear = (after.translation - before.translation) / 2e-5;
                    // For a small turn the vector part of the quaternion is half the rotation
                    // vector.
                    let turn = after.rotation * before.rotation.inverse();
                    let angular =
                        DVec3::new(turn.x, turn.y, turn.z) * (turn.w.signum() * 2.0 / 2e-5);
                    for (row, expected) in
                        linear.to_array().into_iter().chain(angular.to_array()).enumerate()
                    {
                        assert!(
                            (jacobian[row][j] - expected).abs() < 1e-8,
                            "{}: row {row}, joint {j}",
                            robot.name
                        );
                    }
                }
            }
        }
    }

    #[test]
    fn sines_that_are_written_down_are_those_of_libm() {
        for alpha in [0.0, FRAC_PI_2, -FRAC_PI_2] {
            assert_eq!(sincos_of_twist(alpha), [libm::sincos(0.5 * alpha), libm::sincos(alpha)]);
        }
    }

    #[test]
    fn unknown_robots_are_an_error_that_names_the_known_ones() {
        assert_eq!(Robot::by_name("panda").map(|robot| robot.name), Ok("panda"));
        let error = Robot::by_name("ur5").expect_err("not built in").to_string();
        assert!(
            error.contains("ur5") && error.contains("xarm7") && error.contains("panda"),
            "{error}"
        );
    }
}
