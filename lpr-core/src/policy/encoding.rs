//! What the policy's network reads, and the paths that its outputs stand for.

use super::Proposal;
use crate::error::Result;
use crate::features::{
    GOAL_FEATURES, GRIP_SCALE, GoalFrame, JointScale, POSE_FEATURES, command_feature,
    goal_features, grip_features,
};
use crate::path::{BezierCurve, JointPath, follow};
use crate::q_attention::NextBestPose;
use crate::robot::{DOF, JointConfig, Robot};
use std::sync::Arc;

use glamx::{Pose3, Quat, Vec3};
use serde::{Deserialize, Serialize};

/// The straight line that the policy bends.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum PolicySpace {
    /// That of the joints, as in the paper.
    #[default]
    Joints,
    /// That of the grip, seen from the next-best pose.
    Grip,
}

/// Numbers per configuration in joint space: start, goal configuration, next-best pose, fraction of
/// the way.
const JOINT_INPUTS: usize = 2 * DOF + GOAL_FEATURES + 1;
/// Numbers per configuration in the grip's space: where the grip starts, the gripper's command,
/// fraction of the way.
const GRIP_INPUTS: usize = POSE_FEATURES + 2;
/// Offset of the grip: position in units of [`GRIP_SCALE`], and the vector of the turn's quaternion,
/// doubled: radians, where they are few.
const GRIP_OUTPUTS: usize = 6;

/// Between paths and the rows of the network.
#[derive(Debug)]
pub(super) struct Encoding {
    space: PolicySpace,
    joint_scale: JointScale,
    robot: Arc<Robot>,
}

impl Encoding {
    pub(super) fn new(space: PolicySpace, robot: &Arc<Robot>) -> Self {
        Self { space, joint_scale: JointScale::new(robot), robot: Arc::clone(robot) }
    }

    pub(super) const fn n_inputs(&self) -> usize {
        match self.space {
            PolicySpace::Joints => JOINT_INPUTS,
            PolicySpace::Grip => GRIP_INPUTS,
        }
    }

    pub(super) const fn n_outputs(&self) -> usize {
        match self.space {
            PolicySpace::Joints => DOF,
            PolicySpace::Grip => GRIP_OUTPUTS,
        }
    }

    /// Adds `n_configs` rows: the situation, and the fraction of the way.
    pub(super) fn push_inputs(
        &self,
        inputs: &mut Vec<f32>,
        ends: [&JointConfig; 2],
        goal: &NextBestPose,
        n_configs: usize,
    ) {
        let situation: Vec<f32> = match self.space {
            PolicySpace::Joints => {
                let ends = ends.map(|config| self.joint_scale.apply(config));
                ends.into_iter().flatten().chain(goal_features(goal)).collect()
            }
            PolicySpace::Grip => {
                let start = self.robot.grip(ends[0]);
                let seen = GoalFrame::new(&start, &goal.pose).seen(&start);
                grip_features(&seen).into_iter().chain([command_feature(goal.gripper)]).collect()
            }
        };
        for idx in 0..n_configs {
            inputs.extend_from_slice(&situation);
            inputs.push(2.0 * fraction(idx, n_configs) - 1.0);
        }
    }

    /// Adds how far each configuration of `path` lies from the straight line.
    pub(super) fn push_offsets(
        &self,
        offsets: &mut Vec<f32>,
        path: &JointPath,
        goal: &NextBestPose,
    ) {
        let configs = path.configs();
        match self.space {
            PolicySpace::Joints => {
                for (idx, config) in configs.iter().enumerate() {
                    let line = path.start().lerp(path.goal(), fraction(idx, configs.len()));
                    offsets.extend(config.iter().zip(line.iter()).map(|(q, on_line)| q - on_line));
                }
            }
            PolicySpace::Grip => {
                let start = self.robot.grip(path.start());
                let frame = GoalFrame::new(&start, &goal.pose);
                let seen = |config: &JointConfig| frame.seen(&self.robot.grip(config));
                let line = straight(&frame.seen(&start), &seen(path.goal()));
                for (idx, config) in configs.iter().enumerate() {
                    let on_line = line.pose(fraction(idx, configs.len()));
                    offsets.extend(offset(&on_line, &seen(config)));
                }
            }
        }
    }

    /// The path whose configurations lie off the straight line by `offsets`.
    ///
    /// # Errors
    ///
    /// As [`JointPath::new`].
    pub(super) fn bent(
        &self,
        ends: [&JointConfig; 2],
        goal: &NextBestPose,
        offsets: &[f32],
    ) -> Result<Proposal> {
        let offsets: Vec<_> = offsets.chunks_exact(self.n_outputs()).collect();
        let n_configs = offsets.len();
        let [start, end] = ends;
        match self.space {
            PolicySpace::Joints => {
                let configs = offsets.iter().enumerate().map(|(idx, offset)| match idx {
                    // The ends are exact even where the line's arithmetic is not.
                    0 => *start,
                    _ if idx + 1 == n_configs => *end,
                    _ => {
                        let line = start.lerp(end, fraction(idx, n_configs));
                        JointConfig::from_fn(DOF, |j| line[j] + offset[j])
                    }
                });
                JointPath::new(configs.collect()).map(Ok)
            }
            PolicySpace::Grip => {
                let grip = self.robot.grip(start);
                let frame = GoalFrame::new(&grip, &goal.pose);
                let line = straight(&frame.seen(&grip), &frame.seen(&goal.pose));
                let poses: Vec<_> = (0..n_configs)
                    .map(|idx| bent(&line.pose(fraction(idx, n_configs)), offsets[idx]))
                    .map(|seen| frame.placed(&seen))
                    .collect();
                Ok(follow(&self.robot, start, n_configs - 1, |t| between(&poses, t)))
            }
        }
    }
}

/// Fraction of the way of configuration `idx`.
pub(super) fn fraction(idx: usize, n_configs: usize) -> f32 {
    idx as f32 / (n_configs - 1) as f32
}

/// The straight motion from one pose to another, at constant speed.
fn straight(start: &Pose3, end: &Pose3) -> BezierCurve {
    BezierCurve::new(start, 0.5 * (start.translation + end.translation), end)
}

/// The pose at the share `t` of the polygon through `poses`.
fn between(poses: &[Pose3], t: f32) -> Pose3 {
    let at = t * (poses.len() - 1) as f32;
    let idx = (at as usize).min(poses.len() - 2);
    straight(&poses[idx], &poses[idx + 1]).pose(at - idx as f32)
}

/// How far `pose` lies from `on_line`.
fn offset(on_line: &Pose3, pose: &Pose3) -> [f32; GRIP_OUTPUTS] {
    let shift = (pose.translation - on_line.translation) / GRIP_SCALE;
    let turn = on_line.rotation.inverse() * pose.rotation;
    let sign = if turn.w < 0.0 { -2.0 } else { 2.0 };
    [shift.x, shift.y, shift.z, sign * turn.x, sign * turn.y, sign * turn.z]
}

/// The inverse of [`offset`]; a turn of more than half is one of half.
fn bent(on_line: &Pose3, offset: &[f32]) -> Pose3 {
    let shift = GRIP_SCALE * Vec3::from_slice(&offset[..3]);
    let vector = 0.5 * Vec3::from_slice(&offset[3..]);
    let vector = vector / vector.length().max(1.0);
    let w = libm::sqrtf((1.0 - vector.length_squared()).max(0.0));
    let turn = Quat::from_xyzw(vector.x, vector.y, vector.z, w).normalize();
    Pose3::from_parts(on_line.translation + shift, on_line.rotation * turn)
}
