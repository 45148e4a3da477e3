//! An arm: its joints and links, and what else is known of it.

use super::{
    Error, Follower, GripperSpec, Joint, JointConfig, JointOrigin, JointRanges, Link, Result,
};
use crate::rng::Rng;
use core::f32::consts::PI;
use glamx::{DPose3, Vec2};
use rand::RngExt as _;

/// Number of joints of the built-in arms, and of every arm that learns.
pub const DOF: usize = 7;

/// Frames of a built-in arm that carry geometry: link 0 (base) … link 7, then the hand; the fingers
/// are derived from [`GripperSpec`].
pub const N_LINKS: usize = DOF + 2;

/// Index of the hand among the [`N_LINKS`] frames; its geometry is given in the flange frame.
pub const HAND: usize = DOF + 1;

/// A serial arm of at most [`MAX_JOINTS`](super::MAX_JOINTS) joints.
///
/// Body 0 is the base, whose frame is the world; body `i` is what joint `i` (counted from 1)
/// carries, and its frame is the joint's after its motion:
/// `world_from_body_i = world_from_body_(i-1) · parent_from_joint · M(q)` with `M = Rz` for a joint
/// that turns and `M = Tz` for one that slides. A joint with another axis has the turn of its axis
/// in the fixed transforms. Joints that follow another ([`Follower`]) may stand in between.
///
/// The frame that poses and curves are of is `grip`. Of a built-in arm it is between the finger
/// pads, and the flange is that far behind it; of an arm from a file both are its tip:
///
/// ```
/// use lpr_core::robot::{PANDA, XARM7};
///
/// for robot in [&XARM7, &PANDA] {
///     let behind = robot.flange(&robot.start).translation - robot.grip_f64(&robot.start).translation;
///     assert!((behind.length() - robot.flange_from_grip.translation.z).abs() < 1e-9);
/// }
/// ```
///
/// A crane with one joint that lifts and one that turns:
///
/// ```
/// use core::f32::consts::FRAC_PI_2;
/// use lpr_core::glamx::{DPose3, Vec3};
/// use lpr_core::robot::{Joint, JointConfig, JointMotion, JointOrigin, Robot};
///
/// let joint = |name: &str, height: f64, motion| Joint {
///     name: name.to_owned(),
///     origin: JointOrigin::Fixed(DPose3::translation(0.0, 0.0, height)),
///     motion,
///     lower: 0.0,
///     upper: 2.0,
///     is_continuous: false,
///     max_velocity: 1.0,
///     max_acceleration: f32::INFINITY,
/// };
/// let crane = Robot {
///     name: "crane".to_owned(),
///     followers: Vec::new(),
///     joints: vec![joint("lift", 0.2, JointMotion::Slide), joint("turn", 0.1, JointMotion::Turn)],
///     body_from_flange: DPose3::translation(0.5, 0.0, 0.0),
///     flange_from_grip: DPose3::IDENTITY,
///     links: Vec::new(),
///     allowed_self_collisions: Vec::new(),
///     close_pairs: Vec::new(),
///     start: JointConfig::new([0.0; 2]),
///     gripper: None,
///     workspace_center: None,
/// };
/// // 0.4 m up and a quarter turn.
/// let grip = crane.grip(&JointConfig::new([0.4, FRAC_PI_2]));
/// assert!(grip.translation.distance(Vec3::new(0.0, 0.5, 0.7)) < 1e-6);
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct Robot {
    /// Name on the command line, or in the description.
    pub name: String,
    /// Joints from the base.
    pub joints: Vec<Joint>,
    /// Joints that move with another, between base and tip or beside; body `joints.len() + 1 + k` is
    /// what follower `k` carries.
    pub followers: Vec<Follower>,
    /// The flange in the frame of the body that it is on: the last between base and tip.
    pub body_from_flange: DPose3,
    /// `grip` (between the pads, z approach, y opening) in the flange frame.
    pub flange_from_grip: DPose3,
    /// Links with and without geometry; what the arm carries behind its tip is among them. Of a
    /// built-in arm: base, links 1–7, hand without fingers (those are boxes:
    /// [`GripperSpec::fingers`]).
    pub links: Vec<Link>,
    /// Pairs `a < b` of indices into `links` that are never tested against each other, sorted:
    /// neighbours, pairs that overlap in every configuration and pairs that cannot meet.
    pub allowed_self_collisions: Vec<(usize, usize)>,
    /// Pairs `a < b` of indices into `links` that are tested by their geometry where their spheres
    /// touch, sorted; by their spheres alone without the feature `hulls`.
    pub close_pairs: Vec<(usize, usize)>,
    /// Configuration in which episodes and searches start; of an arm from a file, which states
    /// none, the middle of its ranges.
    pub start: JointConfig,
    /// The gripper, if it is known.
    pub gripper: Option<GripperSpec>,
    /// Centre of the workspace on the table, metres, if it is known.
    pub workspace_center: Option<Vec2>,
}

impl Robot {
    /// The gripper.
    ///
    /// # Errors
    ///
    /// When the arm has none: files describe none.
    pub fn gripper(&self) -> Result<&GripperSpec> {
        self.gripper.as_ref().ok_or_else(|| self.lacks("a gripper (pads and fingers)"))
    }

    /// The centre of the workspace on the table, metres.
    ///
    /// # Errors
    ///
    /// When the arm has none: files describe none.
    pub fn workspace_center(&self) -> Result<Vec2> {
        self.workspace_center.ok_or_else(|| self.lacks("a workspace (its centre on the table)"))
    }

    fn lacks(&self, what: &str) -> Error {
        Error::Robot(format!("{}: expected {what}, found none", self.name))
    }

    /// Number of joints, at most [`MAX_JOINTS`](super::MAX_JOINTS).
    #[must_use]
    pub const fn dof(&self) -> usize {
        self.joints.len()
    }

    /// Lower and upper limit of every joint, radians or metres; infinite where it turns without end.
    #[must_use]
    pub fn limits(&self) -> JointRanges {
        self.joints.iter().map(|joint| (joint.lower, joint.upper)).collect()
    }

    /// The configuration with every joint in the middle of its range.
    #[must_use]
    pub fn middle(&self) -> JointConfig {
        middle_of(&self.joints)
    }

    /// A configuration anywhere within the limits; of a joint that turns without end, half a turn
    /// either way.
    #[must_use]
    pub fn random_config(&self, rng: &mut Rng) -> JointConfig {
        JointConfig::from_fn(self.dof(), |j| {
            let joint = &self.joints[j];
            let (lower, upper) =
                if joint.is_continuous { (-PI, PI) } else { (joint.lower, joint.upper) };
            lower + (upper - lower) * rng.random::<f32>()
        })
    }

    /// True if the configuration has the arm's joints, each within its limits.
    ///
    /// ```
    /// use lpr_core::robot::{JointConfig, PANDA};
    ///
    /// let mut config = PANDA.start;
    /// config[3] = PANDA.joints[3].upper;
    /// assert!(PANDA.within_limits(&config), "limits belong to the range");
    /// config[3] += 1e-3;
    /// assert!(!PANDA.within_limits(&config));
    /// config[3] = f32::NAN;
    /// assert!(!PANDA.within_limits(&config));
    /// assert!(!PANDA.within_limits(&JointConfig::new([0.0; 6])), "another arm's");
    /// ```
    #[must_use]
    pub fn within_limits(&self, config: &JointConfig) -> bool {
        config.dof() == self.dof()
            && (self.joints.iter().zip(config.iter()))
                .all(|(joint, &q)| joint.lower <= q && q <= joint.upper)
    }

    /// The arm as a file would describe it: fixed transforms between the joints, and the flange for
    /// a grip.
    ///
    /// ```
    /// use lpr_core::robot::XARM7;
    ///
    /// let arm = XARM7.described();
    /// assert_eq!((arm.dof(), arm.links.len()), (7, 9));
    /// assert!(arm.grip_f64(&XARM7.start).translation.distance(XARM7.flange(&XARM7.start).translation) < 1e-12);
    /// ```
    #[must_use]
    pub fn described(&self) -> Self {
        let joint = |joint: &Joint| Joint {
            origin: JointOrigin::Fixed(joint.parent_from_joint()),
            ..joint.clone()
        };
        Self {
            joints: self.joints.iter().map(joint).collect(),
            flange_from_grip: DPose3::IDENTITY,
            gripper: None,
            ..self.clone()
        }
    }
}

/// Every joint in the middle of its range; one that turns without end at 0.
pub(super) fn middle_of(joints: &[Joint]) -> JointConfig {
    let middle = |joint: &Joint| match joint.is_continuous {
        true => 0.0,
        false => 0.5 * joint.lower + 0.5 * joint.upper,
    };
    JointConfig::from_fn(joints.len(), |j| middle(&joints[j]))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::robot::{JointMotion, MAX_JOINTS, PANDA, ROBOTS, XARM7};
    use core::f32::consts::FRAC_PI_2;
    use glamx::{DVec3, Pose3};
    use proptest::prelude::*;

    /// A column that lifts by 0.2 m and more, and a crane's arm of 0.5 m that turns on it.
    fn crane() -> Robot {
        let text = "<robot name='crane'><link name='a'/><link name='b'/><link name='c'/><link name='d'/>\
            <joint name='lift' type='prismatic'><parent link='a'/><child link='b'/><origin xyz='0 0 0.2'/>\
            <axis xyz='0 0 1'/><limit lower='-0.5' upper='1.5' velocity='1'/></joint>\
            <joint name='turn' type='revolute'><parent link='b'/><child link='c'/><origin xyz='0 0 0.1'/>\
            <axis xyz='0 0 1'/><limit lower='-0.5' upper='1.5' velocity='1'/></joint>\
            <joint name='end' type='fixed'><parent link='c'/><child link='d'/><origin xyz='0.5 0 0'/></joint></robot>";
        Robot::from_urdf(text, None, None, &|_| None).unwrap()
    }

    proptest! {
        #[test]
        fn a_built_in_arm_is_where_its_description_is(angles in prop::array::uniform7(-3.0_f32..3.0)) {
            let config = JointConfig::new(angles);
            for robot in ROBOTS {
                let described = robot.described();
                let (bodies, frames) = (described.body_frames(&config), robot.link_frames(&config));
                for (link, frame) in described.links.iter().zip(frames) {
                    let found = Pose3::from(bodies[link.body] * link.body_from_link);
                    prop_assert!(found.translation.distance(frame.translation) < 1e-6, "{}", link.name);
                    prop_assert!(found.rotation.angle_between(frame.rotation) < 1e-3, "{}", link.name);
                }
                let apart = described.flange(&config).translation - robot.flange(&config).translation;
                prop_assert!(apart.length() < 1e-12);
            }
        }
    }

    #[test]
    fn the_hands_spheres_are_in_the_frame_of_the_flange() {
        let (bodies, frames) = (PANDA.body_frames(&PANDA.start), PANDA.link_frames(&PANDA.start));
        for (link, frame) in PANDA.links.iter().zip(frames) {
            for (found, expected) in link.spheres_in_body().iter().zip(&link.spheres) {
                let found = (bodies[link.body] * found.center.as_dvec3()).as_vec3();
                assert!(found.distance(frame * expected.center) < 1e-6, "{}", link.name);
            }
        }
    }

    #[test]
    fn joints_that_slide_and_joints_that_turn_move_the_tip_in_their_own_way() {
        let at = crane().grip_f64(&JointConfig::new([0.4, FRAC_PI_2])).translation;
        assert!(at.distance(DVec3::new(0.0, 0.5, 0.7)) < 1e-7, "{at}");
        assert_eq!(
            crane().joints.iter().map(|joint| joint.motion).collect::<Vec<_>>(),
            [JointMotion::Slide, JointMotion::Turn]
        );
    }

    #[test]
    fn configurations_of_other_joints_are_outside_the_limits() {
        let crane = crane();
        assert!(crane.within_limits(&JointConfig::new([0.1, 0.2])));
        assert!(!crane.within_limits(&JointConfig::new([0.1, 0.2, 0.0])));
        assert!(!crane.within_limits(&JointConfig::new([0.1])));
        assert_eq!(crane.limits()[..], [(-0.5, 1.5); 2]);
        assert_eq!(crane.start, JointConfig::new([0.5, 0.5]));
        assert!(!XARM7.within_limits(&JointConfig::new([0.0; MAX_JOINTS])));
    }

    #[test]
    fn an_arm_from_a_file_says_what_it_lacks() {
        let crane = crane();
        let error = crane.gripper().unwrap_err().to_string();
        assert_eq!(error, "robot: crane: expected a gripper (pads and fingers), found none");
        let error = crane.workspace_center().unwrap_err().to_string();
        assert!(error.contains("crane: expected a workspace") && error.ends_with("found none"));
    }
}
