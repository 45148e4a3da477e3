//! Why an episode failed: the first step that did not do what the demonstrator does there, and what
//! was wrong with it.

use super::ladder::TracedStep;
use super::poses::PoseError;
use super::reference::Reference;
use crate::agent::Agent;
use crate::env::InvalidAction;
use crate::path::JointPath;
use crate::q_attention::NextBestPose;
use crate::sim::feasibility::KeyframeSnapshot;
use crate::sim::{Grasp, SimEnvironment};

use serde::Serialize;

/// What was wrong with the first step that went wrong.
///
/// The first that holds, in this order. A step whose set held a better path failed by its choice,
/// wherever its pose was.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, strum::IntoStaticStr)]
#[serde(rename_all = "snake_case")]
#[strum(serialize_all = "snake_case")]
pub enum Cause {
    /// Another candidate of the set does what the demonstrator does.
    Choice,
    /// The pose is more than 2 cm or 15° from the demonstrator's, or commands the gripper
    /// otherwise.
    Pose,
    /// No candidate reaches the pose.
    NoPath,
    /// The arm pressed too hard, or went into something.
    Force,
    /// The arm could not follow: its speed, its limits.
    Motion,
    /// What was held is lost.
    Slip,
    /// The gripper closed on nothing.
    Grasp,
    /// What was moved is not where it belongs.
    Placement,
    /// The path takes too long, or the demonstrator would have been done by now.
    Time,
}

impl Cause {
    /// A fixed word for files and counting.
    #[must_use]
    pub fn name(self) -> &'static str {
        self.into()
    }

    /// The cause in words.
    #[must_use]
    pub const fn text(self) -> &'static str {
        match self {
            Self::Choice => "choice among paths: a better one was there",
            Self::Pose => "pose",
            Self::NoPath => "no path to the pose",
            Self::Force => "force",
            Self::Motion => "the arm could not follow",
            Self::Slip => "slip: what was held is lost",
            Self::Grasp => "grasp: the gripper closed on nothing",
            Self::Placement => "placement: what was moved is not where it belongs",
            Self::Time => "time",
        }
    }
}

/// A failed episode.
#[derive(Debug, Clone, Serialize)]
pub struct Failure {
    /// Seed of its scene.
    pub scene_seed: u64,
    /// The first step that went wrong: the number of the demonstrator's keyframe.
    pub step: usize,
    /// What was wrong.
    pub cause: Cause,
    /// More of it, for people: the choices of the pose that were wrong, or the reason of the world.
    pub detail: String,
    /// Distance from the demonstrated position, millimetres.
    pub position_mm: Option<f32>,
    /// Angle from the demonstrated rotation modulo the half turn of a grasp, degrees.
    pub rotation_deg: Option<f32>,
    /// The world before the step.
    #[serde(skip)]
    pub before: SimEnvironment,
    /// The path that ran, if there was one.
    #[serde(skip)]
    pub path: Option<JointPath>,
    /// The pose that was chosen.
    #[serde(skip)]
    pub chosen: NextBestPose,
    /// The demonstrator's; none after its last keyframe.
    #[serde(skip)]
    pub truth: Option<NextBestPose>,
}

/// The cause of the failed episode of `steps` in the scene of `reference`; none of no step.
pub(super) fn first_cause(
    agent: &Agent,
    reference: &Reference,
    steps: &[TracedStep],
) -> Option<Failure> {
    let is_done = |(snapshot, step): (&KeyframeSnapshot, &TracedStep)| {
        snapshot.is_done(&step.after, &step.result)
    };
    // All keyframes done is the task done, so that a failed episode has a step that is not.
    let n_done = reference.keyframes.iter().zip(steps).take_while(|pair| is_done(*pair)).count();
    let idx = n_done.min(steps.len().checked_sub(1)?);
    let step = &steps[idx];
    let snapshot = reference.keyframes.get(idx);
    let chosen = step.action.goal;
    let error = snapshot.map(|snapshot| pose_error(agent, step, &snapshot.goal));
    let (cause, detail) = match (snapshot, &error) {
        (Some(snapshot), Some(error)) => cause(snapshot, error, step),
        _ => (Cause::Time, "the demonstrator would have been done".to_owned()),
    };
    Some(Failure {
        scene_seed: reference.scene_seed,
        step: idx,
        cause,
        detail,
        position_mm: error.as_ref().map(|error| 1e3 * error.position),
        rotation_deg: error.as_ref().map(|error| error.rotation),
        before: step.before.clone(),
        path: step.path.clone(),
        chosen,
        truth: snapshot.map(|snapshot| snapshot.goal),
    })
}

fn pose_error(agent: &Agent, step: &TracedStep, truth: &NextBestPose) -> PoseError {
    match (&agent.networks.q_attention, &step.action.attention) {
        (Some(attention), Some(decision)) => {
            PoseError::of_decision(attention.codec(), decision, truth)
        }
        _ => PoseError::between(&step.action.goal, truth),
    }
}

fn cause(snapshot: &KeyframeSnapshot, error: &PoseError, step: &TracedStep) -> (Cause, String) {
    let TracedStep { before, action, result, after, .. } = step;
    let holds = |environment: &SimEnvironment| environment.world().grasp() != Grasp::Nothing;
    // From where the agent is, to where it wants to go.
    let here = KeyframeSnapshot { env: before.clone(), goal: action.goal, ..snapshot.clone() };
    let better = here.trials(&action.set).iter().filter(|trial| trial.success).count();
    if better > 0 {
        let n = action.set.candidates.len();
        return (Cause::Choice, format!("{better} of {n} candidates would have done it"));
    }
    if !error.is_right() {
        let parts: Vec<_> = error.wrong.iter().map(|part| part.name()).collect();
        return (Cause::Pose, parts.join(", "));
    }
    match result.invalid {
        Some(InvalidAction::NoPath) => (Cause::NoPath, "no candidate".to_owned()),
        Some(reason @ (InvalidAction::Force { .. } | InvalidAction::Collision { .. })) => {
            (Cause::Force, reason.to_string())
        }
        Some(reason @ InvalidAction::TooLong { .. }) => (Cause::Time, reason.to_string()),
        Some(reason) => (Cause::Motion, reason.to_string()),
        None if snapshot.holds && holds(before) && !holds(after) => {
            (Cause::Slip, "held before the step".to_owned())
        }
        None if snapshot.holds && !holds(after) => (Cause::Grasp, "pads closed".to_owned()),
        None => (Cause::Placement, String::new()),
    }
}
