//! Following a curve of the grip with the arm, without a change of posture.

use crate::path::joint_path::JointPath;
use crate::path::rejection::Rejection;
use crate::robot::{DOF, JointConfig, Robot};
use core::f64::consts::PI;
use glamx::Pose3;

/// Times a step along the curve is halved before it counts as a jump: a singularity passed closely
/// needs short steps.
const MAX_HALVINGS: u32 = 3;

/// Samples of the last joint that tell a pose out of reach from one that needs another posture.
const POSTURE_SAMPLES: u32 = 32;

/// The joint path from `start` along `world_from_grip(t)`, `t` from 0 (the grip at `start`) to 1,
/// in `n_steps` equal steps.
///
/// Steps that the arm cannot take at once are halved.
///
/// # Errors
///
/// [`Rejection::CurveUnreachable`] or [`Rejection::BranchJump`] with the fraction of the curve that
/// was followed.
pub(crate) fn follow(
    robot: &Robot,
    start: &JointConfig,
    n_steps: usize,
    world_from_grip: impl Fn(f32) -> Pose3,
) -> Result<JointPath, Rejection> {
    let mut follower =
        Follower { robot, world_from_grip, at: *start, configs: Vec::with_capacity(n_steps + 1) };
    follower.configs.push(*start);
    for step in 0..n_steps {
        follower.advance(
            step as f32 / n_steps as f32,
            (step + 1) as f32 / n_steps as f32,
            MAX_HALVINGS,
        )?;
    }
    Ok(JointPath(follower.configs))
}

struct Follower<'a, C> {
    robot: &'a Robot,
    world_from_grip: C,
    at: JointConfig,
    configs: Vec<JointConfig>,
}

impl<C: Fn(f32) -> Pose3> Follower<'_, C> {
    fn advance(&mut self, from: f32, to: f32, halvings_left: u32) -> Result<(), Rejection> {
        let target = (self.world_from_grip)(to);
        if let Some(config) = self.robot.ik_step(&target, &self.at) {
            self.at = config;
            self.configs.push(config);
            return Ok(());
        }
        // No solution near this posture: either none in any, or the arm would have to jump.
        if !is_in_reach(self.robot, &target, &self.at) {
            return Err(Rejection::CurveUnreachable { fraction: from });
        }
        if halvings_left == 0 {
            return Err(Rejection::BranchJump { fraction: from });
        }
        let middle = 0.5 * (from + to);
        self.advance(from, middle, halvings_left - 1)?;
        self.advance(middle, to, halvings_left - 1)
    }
}

/// True if some posture has that grip pose.
fn is_in_reach(robot: &Robot, world_from_grip: &Pose3, near: &JointConfig) -> bool {
    if !robot.has_closed_form() {
        return robot.ik_nearest(world_from_grip, near).is_some();
    }
    let joint = &robot.joints[DOF - 1];
    let (lower, upper) = (f64::from(joint.lower).max(-PI), f64::from(joint.upper).min(PI));
    (0..POSTURE_SAMPLES).any(|sample| {
        let q7 = lower + (upper - lower) * (f64::from(sample) + 0.5) / f64::from(POSTURE_SAMPLES);
        !robot.ik_all_at(world_from_grip, q7, near).is_empty()
    })
}
