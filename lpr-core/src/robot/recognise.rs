//! Which built-in arm a described one is, so that the closed form serves it.

use super::{Chain, DOF, Joint, JointConfig, Motion, ROBOTS, Robot};
use glamx::DPose3;

/// Most by which frames may differ, metres and radians: descriptions round π/2 to four decimals.
const TOLERANCE: f64 = 5e-5;

impl Chain {
    /// The built-in arm with the kinematics of this one, with this one's limits and with its tip as
    /// `grip`: for the closed form of inverse kinematics. None for other arms.
    ///
    /// Everything else of it, gripper and spheres among it, is the built-in arm's.
    ///
    /// ```
    /// use lpr_core::robot::{Chain, XARM7};
    ///
    /// let mut arm = Chain::from_robot(&XARM7);
    /// arm.joints[0].upper = 1.0;
    /// let robot = arm.as_built_in().expect("its frames are an xArm7's");
    /// assert_eq!((robot.name, robot.joints[0].upper), ("xarm7", 1.0));
    /// assert!(robot.ik_nearest(&robot.grip(&robot.start), &robot.start).is_some());
    ///
    /// arm.joints[3].parent_from_joint.translation.z += 0.01;
    /// assert!(arm.as_built_in().is_none());
    /// ```
    #[must_use]
    pub fn as_built_in(&self) -> Option<Robot> {
        if self.dof() != DOF || self.joints.iter().any(|joint| joint.motion == Motion::Slide) {
            return None;
        }
        ROBOTS.into_iter().find_map(|robot| {
            let flange_from_tip =
                probes().map(|config| robot.flange(&config).inverse() * self.tip_f64(&config));
            let [first, ..] = flange_from_tip;
            flange_from_tip
                .iter()
                .all(|pose| are_close(pose, &first))
                .then(|| self.with_limits_of(robot, first))
        })
    }

    fn with_limits_of(&self, robot: &Robot, flange_from_tip: DPose3) -> Robot {
        let joints = core::array::from_fn(|j| {
            let joint = &self.joints[j];
            Joint {
                lower: joint.lower,
                upper: joint.upper,
                max_velocity: joint.max_velocity,
                ..robot.joints[j]
            }
        });
        Robot { joints, flange_from_grip: flange_from_tip, ..robot.clone() }
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
    use crate::robot::{PANDA, XARM7};
    use glamx::DVec3;

    #[test]
    fn built_in_arms_are_recognised_with_other_limits_tips_and_rounded_angles() {
        for robot in ROBOTS {
            let mut chain = Chain::from_robot(robot);
            chain.joints[1].lower = -1.0;
            chain.joints[2].parent_from_joint.translation.x += 5e-6;
            chain.body_from_tip.translation.z += 0.1;
            let recognised = chain.as_built_in().unwrap();
            assert_eq!((recognised.name, recognised.joints[1].lower), (robot.name, -1.0));
            let config = JointConfig::new([
                0.1,
                -0.2,
                0.3,
                if robot.name == "panda" { -1.4 } else { 1.4 },
                0.5,
                1.6,
                0.7,
            ]);
            let (grip, tip) = (recognised.grip(&config), chain.tip(&config));
            assert!(
                grip.translation.distance(tip.translation) < 1e-4
                    && grip.rotation.angle_between(tip.rotation) < 1e-3
            );
            let solution = recognised.ik_nearest(&tip, &config).unwrap();
            assert!(chain.tip(&solution).translation.distance(tip.translation) < 1e-4);
        }
    }

    #[test]
    fn an_arm_with_another_link_length_or_fewer_joints_is_not() {
        for robot in [&XARM7, &PANDA] {
            let mut longer = Chain::from_robot(robot);
            longer.joints[4].parent_from_joint.translation += 1e-3 * DVec3::Z;
            assert!(longer.as_built_in().is_none());
            let mut shorter = Chain::from_robot(robot);
            shorter.joints.pop();
            assert!(shorter.as_built_in().is_none());
        }
    }
}
