//! Which built-in arm a described one is, so that the closed form serves it.

use super::{DOF, Joint, JointConfig, JointMotion, ROBOTS, Robot};
use glamx::DPose3;

/// Most by which frames may differ, metres and radians: descriptions round π/2 to four decimals.
const TOLERANCE: f64 = 5e-5;

impl Robot {
    /// The built-in arm with the kinematics of this one, with this one's limits and with its tip as
    /// `grip`: for the closed form of inverse kinematics. None for other arms.
    ///
    /// Everything else of it, gripper and spheres among it, is the built-in arm's.
    ///
    /// ```
    /// use lpr_core::glamx::DPose3;
    /// use lpr_core::robot::{JointOrigin, XARM7};
    ///
    /// let mut arm = XARM7.described();
    /// arm.joints[0].upper = 1.0;
    /// let robot = arm.as_built_in().expect("its frames are an xArm7's");
    /// assert_eq!((robot.name.as_str(), robot.joints[0].upper), ("xarm7", 1.0));
    /// assert!(robot.ik_nearest(&robot.grip(&robot.start), &robot.start).is_some());
    ///
    /// let moved = DPose3::translation(0.0, 0.0, 0.01) * arm.joints[3].parent_from_joint();
    /// arm.joints[3].origin = JointOrigin::Fixed(moved);
    /// assert!(arm.as_built_in().is_none());
    /// ```
    #[must_use]
    pub fn as_built_in(&self) -> Option<Self> {
        if self.dof() != DOF
            || !self.followers.is_empty()
            || self
                .joints
                .iter()
                .any(|joint| joint.motion == JointMotion::Slide || joint.is_continuous)
        {
            return None;
        }
        ROBOTS.into_iter().find_map(|robot| {
            let flange_from_tip =
                probes().map(|config| robot.flange(&config).inverse() * self.grip_f64(&config));
            let [first, ..] = flange_from_tip;
            flange_from_tip
                .iter()
                .all(|pose| are_close(pose, &first))
                .then(|| self.with_limits_of(robot, first))
        })
    }

    fn with_limits_of(&self, robot: &Self, flange_from_tip: DPose3) -> Self {
        let joints = (0..DOF).map(|j| {
            let joint = &self.joints[j];
            Joint {
                lower: joint.lower,
                upper: joint.upper,
                max_velocity: joint.max_velocity,
                ..robot.joints[j].clone()
            }
        });
        Self { joints: joints.collect(), flange_from_grip: flange_from_tip, ..robot.clone() }
    }
}

/// Configurations that move every joint: the tip stays where it is at the flange of an arm of the
/// same kinematics only.
fn probes() -> [JointConfig; 2 * DOF] {
    core::array::from_fn(|i| {
        JointConfig::from_fn(DOF, |j| {
            0.3 + 0.1 * j as f32 + if i % DOF == j { 0.7 + (i / DOF) as f32 } else { 0.0 }
        })
    })
}

fn are_close(a: &DPose3, b: &DPose3) -> bool {
    let turn = (a.rotation.inverse() * b.rotation).to_array();
    let is_turned = turn[..3].iter().any(|part| part.abs() > 0.5 * TOLERANCE);
    (a.translation - b.translation).abs().max_element() < TOLERANCE && !is_turned
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::robot::{JointOrigin, PANDA, XARM7};
    use glamx::DVec3;

    fn shift(joint: &mut Joint, by: DVec3) {
        let moved = DPose3::from_translation(by) * joint.parent_from_joint();
        joint.origin = JointOrigin::Fixed(moved);
    }

    #[test]
    fn built_in_arms_are_recognised_with_other_limits_tips_and_rounded_angles() {
        for robot in ROBOTS {
            let mut chain = robot.described();
            chain.joints[1].lower = -1.0;
            shift(&mut chain.joints[2], 5e-6 * DVec3::X);
            chain.body_from_flange.translation.z += 0.1;
            let recognised = chain.as_built_in().unwrap();
            assert_eq!((&recognised.name, recognised.joints[1].lower), (&robot.name, -1.0));
            let config = JointConfig::new([
                0.1,
                -0.2,
                0.3,
                if robot.name == "panda" { -1.4 } else { 1.4 },
                0.5,
                1.6,
                0.7,
            ]);
            let (grip, tip) = (recognised.grip(&config), chain.grip(&config));
            assert!(
                grip.translation.distance(tip.translation) < 1e-4
                    && grip.rotation.angle_between(tip.rotation) < 1e-3
            );
            let solution = recognised.ik_nearest(&tip, &config).unwrap();
            assert!(chain.grip(&solution).translation.distance(tip.translation) < 1e-4);
        }
    }

    #[test]
    fn an_arm_with_another_link_length_or_fewer_joints_is_not() {
        for robot in [&XARM7, &PANDA] {
            let mut longer = robot.described();
            shift(&mut longer.joints[4], 1e-3 * DVec3::Z);
            assert!(longer.as_built_in().is_none());
            let mut shorter = robot.described();
            shorter.joints.pop();
            assert!(shorter.as_built_in().is_none());
        }
    }
}
