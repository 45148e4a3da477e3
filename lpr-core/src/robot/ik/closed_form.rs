//! All solutions at a fixed last joint, in closed form and f64.
//!
//! Both arms have a spherical shoulder (axes 1–3 meet in `S`) and a wrist point `W` (origin of
//! frames 5 and 6); every twist but the first is ±π/2. With `q7` given, frame 6 is known. Then
//! - `|W − S|` depends on `q4` alone: `A cos q4 + B sin q4 = C`, two roots;
//! - the height of `S` along `z5`, seen from frame 6, depends on `q6` alone: again two roots, and
//!   `q5` follows;
//! - what remains is the shoulder's rotation `Rz(q1) Ry(q2) Rz(q3)`: two roots.

use super::super::{DOF, DhRow, JointConfig, Robot};
use core::f64::consts::{PI, TAU};
use glamx::{DMat3, DPose3, DQuat, DVec3, Pose3};

/// Most solutions at one `q7`.
const MAX_BRANCHES: usize = 8;
/// Distance by which a pose may lie beyond the reach and still counts as stretched out, metres:
/// rounding of f32 poses.
const REACH_SLACK: f64 = 3e-7;
/// Most by which the hand may be off where that slack was made use of, metres.
const EXACT: f64 = 5e-5;
/// Angle by which a solution may lie beyond a limit and is moved onto it, radians: rounding of f32
/// poses.
const LIMIT_SLACK: f64 = 5e-7;
/// Sine or lever (metres) below which an angle is undetermined and taken from the reference
/// configuration.
const SINGULAR: f64 = 1e-9;

/// Angles in f64: what the solver works on.
pub(super) type Angles = [f64; DOF];

/// A joint of an arm with a closed form: its modified-DH row and limits.
#[derive(Debug, Clone, Copy)]
struct Revolute {
    alpha: f64,
    a: f64,
    d: f64,
    lower: f32,
    upper: f32,
}

/// True if the arm has a closed form.
pub(super) fn serves(robot: &Robot) -> bool {
    revolutes(robot).is_some()
}

/// The joints of an arm that has a closed form: seven, all by modified-DH rows.
fn revolutes(robot: &Robot) -> Option<[Revolute; DOF]> {
    let mut joints = [Revolute { alpha: 0.0, a: 0.0, d: 0.0, lower: 0.0, upper: 0.0 }; DOF];
    if robot.dof() != DOF {
        return None;
    }
    for (revolute, joint) in joints.iter_mut().zip(&robot.joints) {
        let DhRow { alpha, a, d } = *joint.dh()?;
        *revolute = Revolute { alpha, a, d, lower: joint.lower, upper: joint.upper };
    }
    Some(joints)
}

/// The solutions of one pose at one `q7`: at most eight, all within the limits.
///
/// ```
/// use lpr_core::robot::XARM7;
///
/// let branches = XARM7.ik_all_at(&XARM7.grip(&XARM7.start), 0.0, &XARM7.start);
/// for (config, exact) in branches.iter().zip(branches.angles()) {
///     assert_eq!(config[6], 0.0, "the joint that was given");
///     assert!((f64::from(config[3]) - exact[3]).abs() < 1e-6, "rounded to f32");
/// }
/// ```
#[derive(Debug, Clone)]
pub struct IkBranches {
    angles: [Angles; MAX_BRANCHES],
    len: usize,
}

impl IkBranches {
    pub(super) const EMPTY: Self = Self { angles: [[0.0; DOF]; MAX_BRANCHES], len: 0 };

    fn push(&mut self, angles: Angles) {
        self.angles[self.len] = angles;
        self.len += 1;
    }

    /// The solutions before rounding to f32, radians.
    #[must_use]
    pub fn angles(&self) -> &[[f64; DOF]] {
        &self.angles[..self.len]
    }

    /// The solutions.
    pub fn iter(&self) -> impl ExactSizeIterator<Item = JointConfig> + '_ {
        self.angles().iter().map(rounded)
    }

    /// Number of solutions, 0 to 8.
    #[must_use]
    pub const fn len(&self) -> usize {
        self.len
    }

    /// True if there is none.
    #[must_use]
    pub const fn is_empty(&self) -> bool {
        self.len == 0
    }
}

/// The nearest f32 configuration; limits are f32 values, so it stays within them.
pub(super) fn rounded(angles: &Angles) -> JointConfig {
    JointConfig::new(angles.map(|q| q as f32))
}

/// Angles of `config` in f64.
pub(super) fn widened(config: &JointConfig) -> Angles {
    config.to_array::<DOF>().map(f64::from)
}

/// The pose in f64 with a unit quaternion.
pub(super) fn exact_pose(pose: &Pose3) -> DPose3 {
    let [x, y, z, w] = pose.rotation.to_array().map(f64::from);
    DPose3::from_parts(pose.translation.as_dvec3(), DQuat::from_xyzw(x, y, z, w).normalize())
}

/// A pose of link 7 to be reached, relative to the shoulder.
#[derive(Debug, Clone, Copy)]
pub(super) struct Target<'r> {
    robot: &'r Robot,
    joints: [Revolute; DOF],
    rotation: DMat3,
    /// `S` to the origin of link 7 in the world frame.
    from_shoulder: DVec3,
}

impl<'r> Target<'r> {
    /// The target of an arm with a closed form; none of another arm.
    pub(super) fn new(robot: &'r Robot, world_from_grip: &Pose3) -> Option<Self> {
        let joints = revolutes(robot)?;
        let link7_from_grip = robot.body_from_flange * robot.flange_from_grip;
        let world_from_link7 = exact_pose(world_from_grip) * link7_from_grip.inverse();
        Some(Self {
            robot,
            joints,
            rotation: DMat3::from_quat(world_from_link7.rotation),
            from_shoulder: world_from_link7.translation - DVec3::new(0.0, 0.0, joints[0].d),
        })
    }

    /// All solutions with that `q7`, of each joint the winding nearest `near`.
    pub(super) fn solve(&self, q7: f64, near: &Angles) -> IkBranches {
        let mut branches = IkBranches::EMPTY;
        let Some(q7) = within(&self.joints[6], q7) else { return branches };
        let [_, _, _, joint4, joint5, joint6, joint7] = &self.joints;
        let (sin7, cos7) = libm::sincos(q7);
        let wrist_in_7 = DVec3::new(-joint7.a * cos7, joint7.a * sin7, -joint7.d);
        let shoulder_to_wrist = self.from_shoulder + self.rotation * wrist_in_7;
        let world_from_6 = untwist(unturn(self.rotation, (sin7, cos7)), sign(joint7));
        let shoulder_in_6 = -(world_from_6.transpose() * shoulder_to_wrist);

        let elbows = self.elbow_roots(shoulder_to_wrist.length());
        let is_stretched = elbows.len() == 1;
        for elbow in elbows {
            let Some(q4) = fit(joint4, elbow, near[3]) else { continue };
            let after_elbow = self.shoulder_in_5(elbow);
            let wrists = wrist_roots(shoulder_in_6, after_elbow.z - joint5.d, near[5]);
            let is_touching = is_stretched || wrists.len() == 1;
            for wrist in wrists {
                let Some(q6) = fit(joint6, wrist, near[5]) else { continue };
                let swing = swing(shoulder_in_6, wrist, after_elbow.x, near[4]);
                let Some(q5) = fit(joint5, swing, near[4]) else { continue };
                let world_from_5 = untwist(unturn(world_from_6, wrist), sign(joint6));
                let world_from_4 = untwist(unturn(world_from_5, swing), sign(joint5));
                let world_from_3 = untwist(unturn(world_from_4, elbow), sign(joint4));
                let first = branches.len;
                self.push_shoulder(&mut branches, world_from_3, [q4, q5, q6, q7], near);
                if is_touching {
                    self.keep_exact(&mut branches, first);
                }
            }
        }
        branches
    }

    /// Where two roots meet, the slack for rounding moves the hand by its square root: solutions
    /// that are off by more than [`EXACT`] are dropped, those before `first` left as they are.
    fn keep_exact(&self, branches: &mut IkBranches, first: usize) {
        let mut kept = first;
        for i in first..branches.len {
            let angles = branches.angles[i];
            let wrist = self.robot.frames_at(&angles).tip.translation
                - DVec3::new(0.0, 0.0, self.joints[0].d);
            if (wrist - self.from_shoulder).length() <= EXACT {
                branches.angles[kept] = angles;
                kept += 1;
            }
        }
        branches.len = kept;
    }

    /// Sine and cosine of the two elbow angles that put the wrist at `distance` from the shoulder.
    fn elbow_roots(&self, distance: f64) -> Roots {
        let [_, _, joint3, joint4, joint5, ..] = &self.joints;
        let (upper, offset) = (joint3.d, joint4.a);
        let (x, y) = (joint5.a, -sign(joint5) * joint5.d);
        let a = 2.0 * (offset * x + upper * y);
        let b = 2.0 * (upper * x - offset * y);
        let c = distance * distance - (offset * offset + upper * upper + x * x + y * y);
        roots(a, b, c, 2.0 * distance * REACH_SLACK)
    }

    /// `S` in frame 4 turned by the twist of joint 5 and moved by its `a`: (x, 0, z) before `q5`
    /// turns it about z.
    fn shoulder_in_5(&self, (sin4, cos4): SinCos) -> DVec3 {
        let [_, _, joint3, joint4, joint5, ..] = &self.joints;
        let (x, y) = (-joint4.a, -joint3.d);
        let (turned_x, turned_y) = (cos4 * x + sin4 * y, -sin4 * x + cos4 * y);
        DVec3::new(turned_x - joint5.a, 0.0, -sign(joint5) * turned_y)
    }

    fn push_shoulder(
        &self,
        branches: &mut IkBranches,
        rotation: DMat3,
        [q4, q5, q6, q7]: [f64; 4],
        near: &Angles,
    ) {
        for [q1, q2, q3] in shoulder_roots(rotation, near[0]) {
            let [joint1, joint2, joint3, ..] = &self.joints;
            let shoulder =
                (wind(joint1, q1, near[0]), wind(joint2, q2, near[1]), wind(joint3, q3, near[2]));
            if let (Some(q1), Some(q2), Some(q3)) = shoulder {
                branches.push([q1, q2, q3, q4, q5, q6, q7]);
            }
        }
    }
}

/// Sine and cosine of an angle.
type SinCos = (f64, f64);
/// Up to two angles.
type Roots = core::iter::Take<core::array::IntoIter<SinCos, 2>>;

fn some_roots(roots: [SinCos; 2], n: usize) -> Roots {
    roots.into_iter().take(n)
}

/// The angles with `a cos + b sin = c`; `c` may exceed the amplitude by `slack`.
fn roots(a: f64, b: f64, c: f64, slack: f64) -> Roots {
    let squared = a * a + b * b;
    let amplitude = libm::sqrt(squared);
    if c.abs().partial_cmp(&(amplitude + slack)).is_none_or(core::cmp::Ordering::is_gt) {
        return some_roots([(0.0, 1.0); 2], 0);
    }
    let c = c.clamp(-amplitude, amplitude);
    let side = libm::sqrt((squared - c * c).max(0.0));
    let root = |side: f64| ((b * c + a * side) / squared, (a * c - b * side) / squared);
    some_roots([root(side), root(-side)], if side > 0.0 { 2 } else { 1 })
}

/// Angles of joint 6 that put the shoulder at `height` along `z5`.
fn wrist_roots(shoulder_in_6: DVec3, height: f64, near: f64) -> Roots {
    let (x, y) = (shoulder_in_6.x, shoulder_in_6.y);
    if x.abs() + y.abs() < SINGULAR && height.abs() < REACH_SLACK {
        return some_roots([libm::sincos(near), (0.0, 1.0)], 1);
    }
    roots(y, x, height, REACH_SLACK)
}

/// The angle of joint 5 that turns the shoulder from `lever` along x to where frame 6 sees it.
fn swing(shoulder_in_6: DVec3, (sin6, cos6): SinCos, lever: f64, near: f64) -> SinCos {
    let side = if lever < 0.0 { -1.0 } else { 1.0 };
    let (along, across) =
        (side * (cos6 * shoulder_in_6.x - sin6 * shoulder_in_6.y), side * shoulder_in_6.z);
    let length = libm::sqrt(along * along + across * across);
    if length < SINGULAR { libm::sincos(near) } else { (across / length, along / length) }
}

/// `[q1, q2, q3]` of the two ways to write a rotation as `Rz(q1) Ry(q2) Rz(q3)`.
fn shoulder_roots(rotation: DMat3, near: f64) -> [[f64; 3]; 2] {
    let axis = rotation.z_axis;
    let sin2 = libm::sqrt(axis.x * axis.x + axis.y * axis.y);
    let q2 = libm::atan2(sin2, axis.z);
    let q3 = |(sin1, cos1): SinCos| {
        libm::atan2(
            cos1 * rotation.x_axis.y - sin1 * rotation.x_axis.x,
            cos1 * rotation.y_axis.y - sin1 * rotation.y_axis.x,
        )
    };
    if sin2 < SINGULAR {
        // Only q1 + q3 is determined; the second value serves when the first leaves q3 outside its
        // limits.
        return [near, near + 1.0].map(|q1| [q1, q2, q3(libm::sincos(q1))]);
    }
    let (q1, q3) = (libm::atan2(axis.y, axis.x), q3((axis.y / sin2, axis.x / sin2)));
    [[q1, q2, q3], [opposite(q1), -q2, opposite(q3)]]
}

/// The angle half a turn away, within ±π.
const fn opposite(angle: f64) -> f64 {
    if angle > 0.0 { angle - PI } else { angle + PI }
}

/// Sine of a joint's twist of ±π/2.
const fn sign(joint: &Revolute) -> f64 {
    if joint.alpha < 0.0 { -1.0 } else { 1.0 }
}

/// `m Rz(-angle)`.
fn unturn(m: DMat3, (sin, cos): SinCos) -> DMat3 {
    DMat3::from_cols(m.x_axis * cos - m.y_axis * sin, m.x_axis * sin + m.y_axis * cos, m.z_axis)
}

/// `m Rx(-twist)` for a twist of ±π/2 with that sine.
fn untwist(m: DMat3, sin: f64) -> DMat3 {
    DMat3::from_cols(m.x_axis, m.z_axis * -sin, m.y_axis * sin)
}

fn fit(joint: &Revolute, (sin, cos): SinCos, near: f64) -> Option<f64> {
    wind(joint, libm::atan2(sin, cos), near)
}

/// The winding of `angle` within the limits that is nearest `near`.
fn wind(joint: &Revolute, angle: f64, near: f64) -> Option<f64> {
    // Within a turn and a half, as nearly always, without a division.
    let nearest = match near - angle {
        away if away.abs() <= PI => angle,
        away if away.abs() <= 3.0 * PI => angle + TAU.copysign(away),
        away => angle + TAU * libm::rint(away / TAU),
    };
    let outwards = if nearest < near { TAU } else { -TAU };
    [0.0, outwards, -outwards, 2.0 * outwards, -2.0 * outwards]
        .into_iter()
        .find_map(|turn| within(joint, nearest + turn))
}

/// `angle`, moved onto a limit that it exceeds by no more than rounding; nothing further outside or
/// when not a number.
fn within(joint: &Revolute, angle: f64) -> Option<f64> {
    within_range((joint.lower, joint.upper), angle)
}

/// [`within`] for a range, radians.
pub(super) fn within_range((lower, upper): (f32, f32), angle: f64) -> Option<f64> {
    let (lower, upper) = (f64::from(lower), f64::from(upper));
    let inside = lower - LIMIT_SLACK <= angle && angle <= upper + LIMIT_SLACK;
    inside.then(|| angle.clamp(lower, upper))
}
