//! A serial arm that is described at run time, as joints, links and spheres.
//!
//! Body 0 is the base, whose frame is the world; body `i` is what joint `i` (counted from 1)
//! carries, and its frame is the joint's after its motion:
//! `world_from_body_i = world_from_body_(i-1) · parent_from_joint · M(q)` with `M = Rz` for a joint
//! that turns and `M = Tz` for one that slides. A joint with another axis has the turn of its axis
//! in the fixed transforms.

use super::{DOF, JointConfig, JointRanges, MAX_JOINTS, Robot, Sphere};
use glamx::{DPose3, DQuat, DVec3, Pose3};

/// A serial arm of at most [`MAX_JOINTS`] joints between its base and its tip, and the links that they
/// carry.
///
/// A crane with one joint that lifts and one that turns:
///
/// ```
/// use core::f32::consts::FRAC_PI_2;
/// use lpr_core::glamx::{DPose3, Vec3};
/// use lpr_core::robot::{Chain, ChainJoint, JointConfig, Motion};
///
/// let joint = |name: &str, height: f64, motion| ChainJoint {
///     name: name.to_owned(),
///     parent_from_joint: DPose3::translation(0.0, 0.0, height),
///     motion,
///     lower: 0.0,
///     upper: 2.0,
///     max_velocity: 1.0,
/// };
/// let crane = Chain {
///     name: "crane".to_owned(),
///     joints: vec![joint("lift", 0.2, Motion::Slide), joint("turn", 0.1, Motion::Turn)],
///     body_from_tip: DPose3::translation(0.5, 0.0, 0.0),
///     links: Vec::new(),
///     allowed_self_collisions: Vec::new(),
/// };
/// // 0.4 m up and a quarter turn.
/// let tip = crane.tip(&JointConfig::new([0.4, FRAC_PI_2]));
/// assert!(tip.translation.distance(Vec3::new(0.0, 0.5, 0.7)) < 1e-6);
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct Chain {
    /// Name of the robot.
    pub name: String,
    /// Joints from the base.
    pub joints: Vec<ChainJoint>,
    /// The tip in the frame of the last body.
    pub body_from_tip: DPose3,
    /// Links with and without geometry; what the arm carries behind its tip is among them.
    pub links: Vec<ChainLink>,
    /// Pairs `a < b` of indices into `links` that are never tested against each other, sorted.
    pub allowed_self_collisions: Vec<(usize, usize)>,
}

/// A joint that moves along or about the z axis of its frame.
#[derive(Debug, Clone, PartialEq)]
pub struct ChainJoint {
    /// Name of the joint.
    pub name: String,
    /// The joint's frame at position 0 in the frame of the body before it.
    pub parent_from_joint: DPose3,
    /// How it moves.
    pub motion: Motion,
    /// Lower limit, radians or metres.
    pub lower: f32,
    /// Upper limit, radians or metres.
    pub upper: f32,
    /// Velocity limit, rad/s or m/s.
    pub max_velocity: f32,
}

/// How a joint moves.
///
/// ```
/// use lpr_core::glamx::DVec3;
/// use lpr_core::robot::Motion;
///
/// assert_eq!(Motion::Slide.transform(0.3) * DVec3::X, DVec3::new(1.0, 0.0, 0.3));
/// let turned = Motion::Turn.transform(core::f64::consts::FRAC_PI_2) * DVec3::X;
/// assert!(turned.distance(DVec3::Y) < 1e-12);
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Motion {
    /// About z, by radians.
    Turn,
    /// Along z, by metres.
    Slide,
}

/// A link with the spheres that stand for it.
#[derive(Debug, Clone, PartialEq)]
pub struct ChainLink {
    /// Name of the link.
    pub name: String,
    /// Index of the body that it is part of: 0 for the base, `i` for what joint `i` (counted from
    /// 1) carries.
    pub body: usize,
    /// The link's own frame in the body's.
    pub body_from_link: DPose3,
    /// Collision spheres in the frame of the body.
    pub spheres: Vec<Sphere>,
    /// Furthest that a sphere reaches beyond the geometry it was fitted to, metres; 0 where the
    /// geometry is spheres.
    pub overshoot: f32,
}

impl Chain {
    /// A built-in arm; its tip is the flange.
    ///
    /// ```
    /// use lpr_core::glamx::Pose3;
    /// use lpr_core::robot::{Chain, XARM7};
    ///
    /// let arm = Chain::from_robot(&XARM7);
    /// assert_eq!((arm.dof(), arm.links.len()), (7, 9));
    /// assert!(arm.tip(&XARM7.start).translation.distance(Pose3::from(XARM7.flange(&XARM7.start)).translation) < 1e-6);
    /// ```
    #[must_use]
    pub fn from_robot(robot: &Robot) -> Self {
        let joints = robot.joints.iter().enumerate().map(|(j, joint)| ChainJoint {
            name: format!("joint{}", j + 1),
            parent_from_joint: joint.transform(0.0),
            motion: Motion::Turn,
            lower: joint.lower,
            upper: joint.upper,
            max_velocity: joint.max_velocity,
        });
        let links = robot
            .spheres
            .iter()
            .enumerate()
            .map(|(frame, spheres)| built_in_link(robot, frame, spheres));
        let mut allowed_self_collisions = robot.allowed_self_collisions.to_vec();
        allowed_self_collisions.sort_unstable();
        Self {
            name: robot.name.to_owned(),
            joints: joints.collect(),
            body_from_tip: robot.link7_from_flange,
            links: links.collect(),
            allowed_self_collisions,
        }
    }

    /// Number of joints, at most [`MAX_JOINTS`].
    #[must_use]
    pub const fn dof(&self) -> usize {
        self.joints.len()
    }

    /// Lower and upper limit of every joint, radians or metres.
    #[must_use]
    pub fn limits(&self) -> JointRanges {
        self.joints.iter().map(|joint| (joint.lower, joint.upper)).collect()
    }

    /// The configuration with every joint in the middle of its range.
    #[must_use]
    pub fn middle(&self) -> JointConfig {
        JointConfig::from_fn(self.dof(), |j| {
            0.5 * self.joints[j].lower + 0.5 * self.joints[j].upper
        })
    }

    /// Whether the configuration has the arm's joints, each within its limits.
    #[must_use]
    pub fn within_limits(&self, config: &JointConfig) -> bool {
        config.dof() == self.dof()
            && self
                .joints
                .iter()
                .zip(config.iter())
                .all(|(joint, &q)| joint.lower <= q && q <= joint.upper)
    }

    /// `world_from_body` of the base and what every joint carries, in f64.
    ///
    /// ```
    /// use lpr_core::glamx::DPose3;
    /// use lpr_core::robot::{Chain, PANDA};
    ///
    /// let arm = Chain::from_robot(&PANDA);
    /// let world_from_body = arm.body_frames(&PANDA.start);
    /// assert_eq!(world_from_body[0], DPose3::IDENTITY);
    /// assert_eq!(world_from_body[7] * arm.body_from_tip, arm.tip_f64(&PANDA.start));
    /// ```
    #[must_use]
    pub fn body_frames(&self, config: &JointConfig) -> Vec<DPose3> {
        let frames = self.frames_at(&config.to_array::<MAX_JOINTS>().map(f64::from));
        core::iter::once(DPose3::IDENTITY).chain(frames).take(self.dof() + 1).collect()
    }

    /// `world_from_body` of what every joint carries, at f64 positions; entries without a joint
    /// repeat the last body.
    pub(super) fn frames_at<const N: usize>(&self, positions: &[f64; N]) -> [DPose3; N] {
        let mut world_from_body = DPose3::IDENTITY;
        core::array::from_fn(|j| {
            if let Some(joint) = self.joints.get(j) {
                world_from_body *= joint.transform(positions[j]);
            }
            world_from_body
        })
    }

    /// `world_from_tip` in f64.
    #[must_use]
    pub fn tip_f64(&self, config: &JointConfig) -> DPose3 {
        self.frames_at(&config.to_array::<MAX_JOINTS>().map(f64::from))[MAX_JOINTS - 1]
            * self.body_from_tip
    }

    /// `world_from_tip`.
    #[must_use]
    pub fn tip(&self, config: &JointConfig) -> Pose3 {
        Pose3::from(self.tip_f64(config))
    }
}

impl ChainJoint {
    /// `parent_from_body` at position `q`, radians or metres.
    #[must_use]
    pub fn transform(&self, q: f64) -> DPose3 {
        self.parent_from_joint * self.motion.transform(q)
    }
}

impl Motion {
    /// `joint_from_body` at position `q`, radians or metres.
    #[must_use]
    pub fn transform(self, q: f64) -> DPose3 {
        match self {
            Self::Turn => {
                let (sin, cos) = libm::sincos(0.5 * q);
                DPose3::from_rotation(DQuat::from_xyzw(0.0, 0.0, sin, cos))
            }
            Self::Slide => DPose3::from_translation(DVec3::new(0.0, 0.0, q)),
        }
    }
}

/// Base, links 1–7, hand; the hand's geometry is given in the flange's frame.
fn built_in_link(robot: &Robot, frame: usize, spheres: &[Sphere]) -> ChainLink {
    let (name, body_from_link) = match frame {
        0 => ("base".to_owned(), DPose3::IDENTITY),
        super::HAND => ("hand".to_owned(), robot.link7_from_flange),
        link => (format!("link{link}"), DPose3::IDENTITY),
    };
    let spheres = moved(spheres, &body_from_link);
    ChainLink {
        name,
        body: frame.min(DOF),
        body_from_link,
        spheres,
        overshoot: super::MAX_OVERSHOOT,
    }
}

/// The spheres in another frame.
pub(super) fn moved(spheres: &[Sphere], to_from_here: &DPose3) -> Vec<Sphere> {
    let moved = |sphere: &Sphere| Sphere {
        center: (*to_from_here * sphere.center.as_dvec3()).as_vec3(),
        ..*sphere
    };
    spheres.iter().map(moved).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::robot::{PANDA, ROBOTS};
    use proptest::prelude::*;

    /// A column that lifts by 0.2 m and more, and a crane's arm of 0.5 m that turns on it.
    fn crane() -> Chain {
        let joint = |name: &str, height: f64, motion| ChainJoint {
            name: name.to_owned(),
            parent_from_joint: DPose3::from_translation(DVec3::new(0.0, 0.0, height)),
            motion,
            lower: -0.5,
            upper: 1.5,
            max_velocity: 1.0,
        };
        Chain {
            name: "crane".to_owned(),
            joints: vec![joint("lift", 0.2, Motion::Slide), joint("turn", 0.1, Motion::Turn)],
            body_from_tip: DPose3::from_translation(DVec3::new(0.5, 0.0, 0.0)),
            links: Vec::new(),
            allowed_self_collisions: Vec::new(),
        }
    }

    proptest! {
        #[test]
        fn a_built_in_arm_and_its_chain_are_where_the_other_is(angles in prop::array::uniform7(-3.0_f32..3.0)) {
            let config = JointConfig::new(angles);
            for robot in ROBOTS {
                let chain = Chain::from_robot(robot);
                let (bodies, frames) = (chain.body_frames(&config), robot.link_frames(&config));
                for (link, frame) in chain.links.iter().zip(frames) {
                    let found = Pose3::from(bodies[link.body] * link.body_from_link);
                    prop_assert!(found.translation.distance(frame.translation) < 1e-6, "{}", link.name);
                    prop_assert!(found.rotation.angle_between(frame.rotation) < 1e-3, "{}", link.name);
                }
                prop_assert!(chain.tip_f64(&config).translation.distance(robot.flange(&config).translation) < 1e-12);
            }
        }
    }

    #[test]
    fn the_hands_spheres_are_in_the_frame_of_the_last_body() {
        let chain = Chain::from_robot(&PANDA);
        let config = PANDA.start;
        let (bodies, frames) = (chain.body_frames(&config), PANDA.link_frames(&config));
        for (link, (frame, spheres)) in chain.links.iter().zip(frames.iter().zip(PANDA.spheres)) {
            for (found, expected) in link.spheres.iter().zip(spheres) {
                let found = (bodies[link.body] * found.center.as_dvec3()).as_vec3();
                assert!(found.distance(*frame * expected.center) < 1e-6, "{}", link.name);
            }
        }
    }

    #[test]
    fn joints_that_slide_and_joints_that_turn_move_the_tip_in_their_own_way() {
        let config = JointConfig::new([0.4, core::f32::consts::FRAC_PI_2]);
        let at = crane().tip_f64(&config).translation;
        assert!(at.distance(DVec3::new(0.0, 0.5, 0.7)) < 1e-7, "{at}");
    }

    #[test]
    fn configurations_of_other_joints_are_outside_the_limits() {
        let crane = crane();
        assert!(crane.within_limits(&JointConfig::new([0.1, 0.2])));
        assert!(!crane.within_limits(&JointConfig::new([0.1, 0.2, 0.0])));
        assert!(!crane.within_limits(&JointConfig::new([0.1])));
        assert_eq!(crane.limits()[..], [(-0.5, 1.5); 2]);
        assert_eq!(crane.middle(), JointConfig::new([0.5, 0.5]));
    }
}
