//! A decision as JSON: the pose, what Q-attention saw, every candidate with its value, and why the
//! others are none.

use lpr_core::agent::Action;
use lpr_core::glamx::{Quat, Vec3};
use lpr_core::path::CandidatePath;
use lpr_core::q_attention::{DepthDecision, QDecision};
use lpr_core::robot::{Gripper, JointConfig, Robot};
use serde::Serialize;
use std::collections::BTreeMap;

/// Voxels of a depth that are drawn: those of highest value.
const TOP_VOXELS: usize = 96;

/// A decision of the agent.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Plan {
    /// Index of the macro action in its episode.
    pub step: u64,
    /// The pose that the paths lead to.
    pub goal: Goal,
    /// Q-attention's steps to the goal, coarse to fine; empty with the demonstrator's poses.
    pub depths: Vec<Depth>,
    /// Value of the pose; none with the demonstrator's poses.
    pub goal_value: Option<f32>,
    /// The candidates, in the order planner, Bézier, policy.
    pub candidates: Vec<Candidate>,
    /// Draws that gave no candidate.
    pub rejected: Vec<Rejected>,
    /// Index of the candidate that the agent runs.
    pub chosen: Option<usize>,
}

/// The next-best pose.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Goal {
    /// Of `grip` in the world, metres.
    pub position: Vec3,
    /// `world_from_grip`.
    pub rotation_xyzw: Quat,
    /// The gripper's command there.
    pub gripper: Gripper,
}

/// The best voxel of one depth of Q-attention.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Depth {
    /// Length of a voxel's sides along x, y, z, metres.
    pub voxel_size: Vec3,
    /// Centres of the voxels of highest value, metres, the best first.
    pub centers: Vec<Vec3>,
    /// Their values.
    pub values: Vec<f32>,
}

/// A path that was ranked.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Candidate {
    /// Which generator made it.
    pub source: &'static str,
    /// The ranker's value; none without a ranker.
    pub value: Option<f32>,
    /// True if the arm meets the scene or itself on the way.
    pub collides: bool,
    /// Length in joint space, radians.
    pub length: f32,
    /// The configurations, radians.
    pub path: Vec<JointConfig>,
    /// Positions of `grip` at each of them, metres.
    pub grip: Vec<Vec3>,
}

/// Draws of one generator that failed for the same reason.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Rejected {
    /// The generator.
    pub source: &'static str,
    /// Reason of the failure.
    pub reason: &'static str,
    /// Number of draws.
    pub count: usize,
}

impl Plan {
    /// The decision `action` of macro action `step`.
    #[must_use]
    pub fn new(action: &Action, robot: &Robot, step: u64) -> Self {
        let value = |idx: usize| action.values.as_ref().and_then(|values| values.get(idx)).copied();
        let candidates = action.set.candidates.iter().enumerate();
        Self {
            step,
            goal: Goal {
                position: action.goal.pose.translation,
                rotation_xyzw: action.goal.pose.rotation,
                gripper: action.goal.gripper,
            },
            depths: action
                .attention
                .iter()
                .flat_map(|decision| &decision.depths)
                .map(Depth::new)
                .collect(),
            goal_value: action.attention.as_ref().map(|QDecision { value, .. }| *value),
            candidates: candidates
                .map(|(idx, candidate)| Candidate::new(candidate, value(idx), robot))
                .collect(),
            rejected: rejected(action),
            chosen: action.chosen,
        }
    }
}

impl Depth {
    fn new(decision: &DepthDecision) -> Self {
        let DepthDecision { grid, values } = decision;
        let mut best: Vec<usize> = (0..values.len()).collect();
        best.sort_by(|&a, &b| values[b].total_cmp(&values[a]));
        best.truncate(TOP_VOXELS);
        let center =
            |&voxel: &usize| grid.space.point_from_voxel(grid.space.voxel_from_flat(voxel));
        Self {
            voxel_size: grid.space.voxel_size(),
            centers: best.iter().map(center).collect(),
            values: best.iter().map(|&voxel| values[voxel]).collect(),
        }
    }
}

impl Candidate {
    fn new(candidate: &CandidatePath, value: Option<f32>, robot: &Robot) -> Self {
        let configs = candidate.path.configs();
        Self {
            source: candidate.source.name(),
            value,
            collides: candidate.collides,
            length: candidate.path.length(),
            path: configs.to_vec(),
            grip: configs.iter().map(|config| robot.grip(config).translation).collect(),
        }
    }
}

fn rejected(action: &Action) -> Vec<Rejected> {
    let mut counts = BTreeMap::new();
    for rejected in &action.set.rejected {
        *counts.entry((rejected.source.name(), rejected.reason.name())).or_insert(0) += 1;
    }
    counts.into_iter().map(|((source, reason), count)| Rejected { source, reason, count }).collect()
}
