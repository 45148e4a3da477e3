//! Can any candidate do it? Every candidate of a keyframe, executed from a snapshot, without
//! learning.

use super::demonstrate;
use crate::env::{Environment as _, StepResult};
use crate::in_order::map_in_order;
use crate::path::{
    CandidatePath, CandidateSet, CandidateSettings, CandidateStreams, PathQuery, Source,
    candidates, linear_candidate,
};
use crate::q_attention::NextBestPose;
use crate::rng::{Stream, stream};
use crate::sim::environment::SimEnvironment;
use crate::sim::world::Grasp;

/// Greatest difference of a joint from where the demonstrator leaves it, before the last keyframe,
/// as a share of its range.
const JOINT_TOLERANCE: f32 = 0.1;

/// A snapshot in which the demonstrator's next keyframe is `goal`.
#[derive(Debug, Clone)]
pub struct KeyframeSnapshot {
    /// The environment before the keyframe's motion.
    pub env: SimEnvironment,
    /// The demonstrator's goal.
    pub goal: NextBestPose,
    /// True for the demonstrator's last keyframe, whose motion should do the task.
    pub is_last: bool,
    /// True when the demonstrator held something after the keyframe.
    pub holds: bool,
    /// Coordinates of the scene's joints after the demonstrator's keyframe, radians or metres.
    pub joints: Vec<f32>,
}

/// The snapshots of a demonstration in `env`, which has just been reset; `None` when the
/// demonstration fails.
#[must_use]
pub fn keyframe_snapshots(env: &SimEnvironment, seed: u64) -> Option<Vec<KeyframeSnapshot>> {
    let mut worker = env.clone();
    let demo = demonstrate(&mut worker, &mut stream(seed, Stream::Demo, 0));
    if !demo.success {
        return None;
    }
    let mut snapshots = Vec::new();
    let mut start = 0;
    for (step, &end) in demo.waypoint_frames.iter().enumerate() {
        snapshots.push(KeyframeSnapshot {
            env: env.at(demo.frames[start].clone(), step),
            goal: env.plan().goals[step],
            is_last: step + 1 == env.plan().goals.len(),
            holds: demo.frames[end].grasp() != Grasp::Nothing,
            joints: demo.frames[end].joint_positions(),
        });
        start = end;
    }
    Some(snapshots)
}

/// Outcome of one candidate.
#[derive(Debug, Clone)]
pub struct Trial {
    /// The generator of the path.
    pub source: Source,
    /// The environment's answer.
    pub result: StepResult,
    /// True when it did what the demonstrator did: the task at the last keyframe, else the same
    /// grasp with the scene's joints as far moved, without an invalid action.
    pub success: bool,
}

/// The candidates of a keyframe with what became of each, and of the straight line of the grip.
#[derive(Debug, Clone)]
pub struct KeyframeTrials {
    /// The candidate set.
    pub set: CandidateSet,
    /// One trial for each candidate of the set, in its order.
    pub trials: Vec<Trial>,
    /// The straight line; `None` when the arm cannot follow it.
    pub linear: Option<Trial>,
}

impl KeyframeSnapshot {
    /// The candidates that an agent without a path policy would rank here.
    #[must_use]
    pub fn candidates(
        &self,
        settings: &CandidateSettings,
        streams: CandidateStreams,
    ) -> CandidateSet {
        self.ask(|query| candidates(query, settings, streams))
    }

    /// Executes every candidate from this snapshot.
    #[must_use]
    pub fn execute_all(
        &self,
        settings: &CandidateSettings,
        streams: CandidateStreams,
    ) -> KeyframeTrials {
        let set = self.candidates(settings, streams);
        KeyframeTrials { trials: self.trials(&set), linear: self.linear_trial(settings), set }
    }

    /// Executes every candidate of `set` from this snapshot.
    #[must_use]
    pub fn trials(&self, set: &CandidateSet) -> Vec<Trial> {
        map_in_order(set.candidates.len(), |idx| self.execute(&set.candidates[idx]))
    }

    /// Executes the straight line of the grip from this snapshot; `None` when the arm cannot follow
    /// it.
    #[must_use]
    pub fn linear_trial(&self, settings: &CandidateSettings) -> Option<Trial> {
        self.ask(|query| linear_candidate(query, settings))
            .ok()
            .map(|candidate| self.execute(&candidate))
    }

    /// Asks `answer` about the goal among the obstacles that the cameras see now.
    fn ask<T>(&self, answer: impl FnOnce(&PathQuery<'_>) -> T) -> T {
        let mut env = self.env.clone();
        let scene = env.obstacles(Some(&self.goal.pose));
        let start = *env.world().config();
        answer(&PathQuery { robot: env.robot(), start, goal: self.goal.pose, scene: &scene })
    }

    fn execute(&self, candidate: &CandidatePath) -> Trial {
        let mut env = self.env.clone();
        let result = env.step(&candidate.path, self.goal.gripper);
        Trial { source: candidate.source, success: self.is_done(&env, &result), result }
    }

    /// True if a step with that result, after which the world is as in `env`, did what the
    /// demonstrator did: see [`Trial::success`].
    #[must_use]
    pub fn is_done(&self, env: &SimEnvironment, result: &StepResult) -> bool {
        let same_grasp = (env.world().grasp() != Grasp::Nothing) == self.holds;
        let moved = !joints_differ(env, &self.joints);
        let followed = !self.is_last && result.invalid.is_none() && same_grasp && moved;
        result.reward > 0.0 || followed
    }

    /// True if the demonstrator moves a joint of the scene here: a hinge turns, or a drawer slides.
    #[must_use]
    pub fn moves_a_joint(&self) -> bool {
        joints_differ(&self.env, &self.joints)
    }
}

/// True if a joint of the scene is not where `goal` has it.
fn joints_differ(env: &SimEnvironment, goal: &[f32]) -> bool {
    let joints = env.world().joint_positions().into_iter().zip(goal);
    joints.zip(&env.world().spec().joints).any(|((at, goal), joint)| {
        let range = joint.limits[1] - joint.limits[0];
        (at - goal).abs() > JOINT_TOLERANCE * range
    })
}
