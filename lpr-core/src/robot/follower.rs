//! Joints that move with another: the `<mimic>` of descriptions.

use super::JointMotion;
use glamx::DPose3;

/// A joint without a motor: its position is `multiplier · q + offset`, where `q` is that of a joint
/// of the arm.
///
/// ```
/// use lpr_core::robot::Robot;
///
/// let joint = |name: &str, parent: &str, child: &str, mimic: &str| {
///     format!(
///         r#"<joint name="{name}" type="revolute"><parent link="{parent}"/><child link="{child}"/><origin xyz="1 0 0"/>
///         <axis xyz="0 0 1"/><limit lower="-2" upper="2" velocity="1"/>{mimic}</joint>"#
///     )
/// };
/// let urdf = format!(
///     r#"<robot name="r"><link name="a"/><link name="b"/><link name="c"/>{}{}</robot>"#,
///     joint("knee", "a", "b", ""),
///     joint("ankle", "b", "c", r#"<mimic joint="knee" multiplier="-1"/>"#),
/// );
/// let leg = Robot::from_urdf(&urdf, None, None, &|_| None)?;
/// assert_eq!((leg.dof(), leg.followers[0].multiplier), (1, -1.0));
/// // What the knee turns, the ankle turns back.
/// let mut bent = leg.start;
/// bent[0] = 1.0;
/// assert!(leg.grip(&bent).rotation.angle_between(leg.grip(&leg.start).rotation) < 1e-3);
/// # Ok::<(), lpr_core::Error>(())
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct Follower {
    /// Name of the joint.
    pub name: String,
    /// Body that it stands on; of several followers, a parent comes before what stands on it.
    pub parent: usize,
    /// Its frame in that body at position 0; it moves about or along its z.
    pub parent_from_joint: DPose3,
    /// Its motion.
    pub motion: JointMotion,
    /// Index of the joint that it follows.
    pub joint: usize,
    /// Factor of that joint's position.
    pub multiplier: f64,
    /// Position where that joint is at 0, radians or metres.
    pub offset: f64,
    /// True between base and tip: the next joint, or the flange, stands on what it carries.
    pub is_in_chain: bool,
}

impl Follower {
    /// Its position where the joint that it follows is at `q`, radians or metres.
    pub(super) fn position(&self, q: f64) -> f64 {
        self.multiplier * q + self.offset
    }

    /// `parent_from_body` where the joint that it follows is at `q`, radians or metres.
    pub(super) fn transform(&self, q: f64) -> DPose3 {
        self.parent_from_joint * self.motion.transform(self.position(q))
    }
}
