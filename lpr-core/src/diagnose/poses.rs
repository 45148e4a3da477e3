//! Errors of the chosen poses against the demonstrator's, and which of the separate choices made
//! them.

use crate::agent::{Agent, Eyes};
use crate::in_order::map_in_order;
use crate::perception::Observation;
use crate::q_attention::{
    ActionCodec, DiscreteAction, NextBestPose, QAttention, QDecision, RotationCodec, half_turned,
};

use glamx::{Quat, Vec3};
use serde::Serialize;
use std::collections::BTreeMap;

/// Farther from the demonstrated position than this is wrong, metres.
pub const NEAR: f32 = 0.02;
/// Turned farther from the demonstrated rotation than this is wrong, degrees.
pub const TURNED: f32 = 15.0;

/// A keyframe at which a pose is to be chosen.
#[derive(Debug, Clone)]
pub(super) struct PoseCase {
    pub(super) keyframe: usize,
    pub(super) observation: Observation,
    /// The demonstrated poses of all keyframes of the scene.
    pub(super) goals: Vec<NextBestPose>,
}

/// One of the separate choices that make a pose.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Part {
    /// The voxel of a depth.
    Voxel(usize),
    /// The angle about x.
    Roll,
    /// The angle about y.
    Pitch,
    /// The angle about z.
    Yaw,
    /// The gripper's command.
    Gripper,
}

impl Part {
    const ANGLES: [Self; 3] = [Self::Roll, Self::Pitch, Self::Yaw];

    /// A fixed word for files and for reading.
    #[must_use]
    pub fn name(self) -> String {
        match self {
            Self::Voxel(depth) => format!("voxel of depth {depth}"),
            Self::Roll => "roll".to_owned(),
            Self::Pitch => "pitch".to_owned(),
            Self::Yaw => "yaw".to_owned(),
            Self::Gripper => "gripper".to_owned(),
        }
    }
}

/// Difference of a chosen pose from a demonstrated one.
#[derive(Debug, Clone, PartialEq)]
pub struct PoseError {
    /// Distance of the positions, metres.
    pub position: f32,
    /// Angle between the rotations, degrees, modulo the half turn of a two-finger grasp.
    pub rotation: f32,
    /// True if the gripper gets the demonstrated command.
    pub gripper: bool,
    /// The choices that were wrong; only of poses that Q-attention chose.
    pub wrong: Vec<Part>,
}

impl PoseError {
    /// Of any pose, without the choices that made it.
    #[must_use]
    pub fn between(chosen: &NextBestPose, truth: &NextBestPose) -> Self {
        let position = chosen.pose.translation.distance(truth.pose.translation);
        let rotation = equivalent(truth.pose.rotation)
            .map(|rotation| angle_between(chosen.pose.rotation, rotation))
            .into_iter()
            .fold(f32::INFINITY, f32::min);
        let gripper = chosen.gripper == truth.gripper;
        Self { position, rotation, gripper, wrong: Vec::new() }
    }

    pub(super) fn of_decision(
        codec: &ActionCodec,
        decision: &QDecision,
        truth: &NextBestPose,
    ) -> Self {
        let error = Self::between(&decision.goal, truth);
        let mut wrong = Vec::new();
        wrong.extend(wrong_voxel(decision, truth.pose.translation));
        if error.rotation > TURNED {
            wrong.extend(wrong_angles(codec.rotation, &decision.action, truth.pose.rotation));
        }
        if !error.gripper {
            wrong.push(Part::Gripper);
        }
        Self { wrong, ..error }
    }

    /// True if position and rotation are within [`NEAR`] and [`TURNED`].
    #[must_use]
    pub fn is_near(&self) -> bool {
        self.position <= NEAR && self.rotation <= TURNED
    }

    /// True if it is near and the gripper gets the right command.
    #[must_use]
    pub fn is_right(&self) -> bool {
        self.is_near() && self.gripper
    }
}

/// The rotation, and the other of the same grasp.
fn equivalent(rotation: Quat) -> [Quat; 2] {
    [rotation, half_turned(rotation)]
}

/// Degrees.
fn angle_between(a: Quat, b: Quat) -> f32 {
    let between = a.inverse() * b;
    let sine = libm::sqrtf(between.x * between.x + between.y * between.y + between.z * between.z);
    (2.0 * libm::atan2f(sine, between.w.abs())).to_degrees()
}

/// The first depth whose voxel leaves `truth` out of reach of the later ones; of the last depth, one
/// that is too far away.
fn wrong_voxel(decision: &QDecision, truth: Vec3) -> Option<Part> {
    let last = decision.depths.len() - 1;
    (0..=last)
        .find(|&depth| match decision.depths.get(depth + 1) {
            Some(next) => !next.grid.space.bounds().contains(truth),
            None => {
                let space = &decision.depths[depth].grid.space;
                let center = space.point_from_voxel(decision.action.voxels[depth]);
                center.distance(truth) > NEAR
            }
        })
        .map(Part::Voxel)
}

/// The angles that are far from those of the nearer of the two equivalent grasps; the farthest
/// where none alone is.
fn wrong_angles(codec: RotationCodec, chosen: &DiscreteAction, truth: Quat) -> Vec<Part> {
    let at = codec.decode(chosen.rotation);
    let [kept, turned] = equivalent(truth);
    let nearer = if angle_between(at, kept) <= angle_between(at, turned) { kept } else { turned };
    let labels = codec.encode(nearer);
    let off = |axis: usize| degrees_between(codec, chosen.rotation[axis], labels[axis]);
    let far: Vec<_> = (0..3).filter(|&axis| off(axis) > TURNED).collect();
    let farthest = (0..3).max_by(|&a, &b| off(a).total_cmp(&off(b)));
    let axes = if far.is_empty() { farthest.into_iter().collect() } else { far };
    axes.into_iter().map(|axis| Part::ANGLES[axis]).collect()
}

/// Angle between two bins around the circle, degrees.
pub(super) fn degrees_between(codec: RotationCodec, a: usize, b: usize) -> f32 {
    let bins = a.abs_diff(b);
    bins.min(codec.n_bins - bins) as f32 * 360.0 / codec.n_bins as f32
}

/// Median and 90 % quantile.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Quantiles {
    /// Half of the values are at most this.
    pub median: f32,
    /// Nine of ten are.
    pub p90: f32,
}

impl Quantiles {
    fn of(mut values: Vec<f32>) -> Self {
        values.sort_by(f32::total_cmp);
        let at = |percent: usize| {
            let idx = (values.len() * percent).div_ceil(100).max(1) - 1;
            values.get(idx).copied().unwrap_or(f32::NAN)
        };
        Self { median: at(50), p90: at(90) }
    }
}

/// Errors at one keyframe over all scenes.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct KeyframePoses {
    /// The keyframe, from 0.
    pub keyframe: usize,
    /// Poses that were chosen.
    pub cases: usize,
    /// Share within 2 cm and 15°.
    pub near: f64,
    /// Share within 2 cm and 15° with the right command of the gripper.
    pub right: f64,
    /// Distance from the demonstrated position, millimetres.
    pub position_mm: Quantiles,
    /// Angle from the demonstrated rotation modulo the half turn of a grasp, degrees.
    pub rotation_deg: Quantiles,
    /// Share with the right command of the gripper.
    pub gripper: f64,
    /// Share in which each of the choices was wrong; those that never were are left out.
    pub wrong: BTreeMap<String, f64>,
    /// Share in which the pose is that of another keyframe of the scene, by this keyframe.
    pub taken_for: BTreeMap<usize, f64>,
}

/// Errors of the poses of an agent.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct PoseReport {
    /// In other scenes than it learned from, in the states that the demonstrator leaves.
    pub scenes: Vec<KeyframePoses>,
    /// The same where each depth after the first looks at the right place.
    pub guided: Vec<KeyframePoses>,
    /// On the demonstrations that it learned from.
    pub demonstrations: Vec<KeyframePoses>,
}

/// One choice of a pose.
struct Choice {
    error: PoseError,
    taken_for: Option<usize>,
}

/// Errors of the poses that `agent` chooses at `cases`, by keyframe; with `guided`, every depth
/// after the first looks where the demonstrator's pose is.
pub(super) fn keyframe_poses(
    agent: &Agent,
    cases: &[PoseCase],
    guided: bool,
) -> Vec<KeyframePoses> {
    let Some(attention) = &agent.networks.q_attention else { return Vec::new() };
    let choices = map_in_order(cases.len(), |idx| choice(agent, attention, &cases[idx], guided));
    let n_keyframes = cases.iter().map(|case| case.keyframe + 1).max().unwrap_or(0);
    let of_keyframe = |keyframe: usize| {
        let here: Vec<_> = cases
            .iter()
            .zip(&choices)
            .filter(|(case, _)| case.keyframe == keyframe)
            .filter_map(|(_, choice)| choice.as_ref())
            .collect();
        (!here.is_empty()).then(|| summary(keyframe, &here))
    };
    (0..n_keyframes).filter_map(of_keyframe).collect()
}

fn choice(agent: &Agent, attention: &QAttention, case: &PoseCase, guided: bool) -> Option<Choice> {
    let truth = &case.goals[case.keyframe];
    let decision = if guided {
        // Poses outside the scene's bounds have no voxel that could lead there.
        let guide = attention.codec().encode(truth)?;
        let seen = agent.attended(&case.observation)?;
        attention.act_guided(&seen, agent.acting_weights(), &guide.voxels)
    } else {
        agent.attend(case.observation.clone(), Eyes::Open).attention?
    };
    let error = PoseError::of_decision(attention.codec(), &decision, truth);
    let is_other =
        |(_, goal): &(usize, &NextBestPose)| PoseError::between(&decision.goal, goal).is_right();
    let other = case.goals.iter().enumerate().find(is_other).map(|(keyframe, _)| keyframe);
    let taken_for = if error.is_near() { None } else { other };
    Some(Choice { error, taken_for })
}

fn summary(keyframe: usize, choices: &[&Choice]) -> KeyframePoses {
    let n = choices.len();
    let share = |test: &dyn Fn(&Choice) -> bool| {
        choices.iter().filter(|choice| test(choice)).count() as f64 / n as f64
    };
    let values = |of: &dyn Fn(&PoseError) -> f32| {
        Quantiles::of(choices.iter().map(|choice| of(&choice.error)).collect())
    };
    let mut wrong = BTreeMap::new();
    let mut taken_for = BTreeMap::new();
    for choice in choices {
        for part in &choice.error.wrong {
            *wrong.entry(part.name()).or_default() += 1.0 / n as f64;
        }
        if let Some(other) = choice.taken_for {
            *taken_for.entry(other).or_default() += 1.0 / n as f64;
        }
    }
    KeyframePoses {
        keyframe,
        cases: n,
        near: share(&|choice| choice.error.is_near()),
        right: share(&|choice| choice.error.is_right()),
        position_mm: values(&|error| 1e3 * error.position),
        rotation_deg: values(&|error| error.rotation),
        gripper: share(&|choice| choice.error.gripper),
        wrong,
        taken_for,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::robot::Gripper;
    use core::f32::consts::PI;
    use glamx::Pose3;

    const CODEC: RotationCodec = RotationCodec { n_bins: 72 };

    fn goal(translation: Vec3, rotation: Quat) -> NextBestPose {
        NextBestPose { pose: Pose3::from_parts(translation, rotation), gripper: Gripper::Open }
    }

    #[test]
    fn half_a_turn_about_the_approach_is_no_error_and_about_another_axis_is() {
        let down = Quat::from_rotation_x(PI);
        let truth = goal(Vec3::ZERO, down);
        let turned = goal(Vec3::new(0.012, 0.0, 0.0), down * Quat::from_rotation_z(PI));
        let error = PoseError::between(&turned, &truth);
        assert!(error.rotation < 0.1 && (error.position - 0.012).abs() < 1e-6, "{error:?}");
        assert!(error.is_right());
        let aside = goal(Vec3::ZERO, down * Quat::from_rotation_x(0.5));
        let error = PoseError::between(&aside, &truth);
        assert!((error.rotation - 0.5_f32.to_degrees()).abs() < 0.1 && !error.is_near());
    }

    #[test]
    fn the_wrong_angle_is_named_for_either_of_two_equivalent_grasps() {
        let truth = Quat::from_rotation_z(0.4) * Quat::from_rotation_x(PI);
        let action = |rotation| DiscreteAction {
            voxels: Vec::new(),
            rotation: CODEC.encode(rotation),
            gripper: Gripper::Open,
        };
        for equivalent in equivalent(truth) {
            let off = Quat::from_rotation_z(0.6) * equivalent;
            assert_eq!(wrong_angles(CODEC, &action(off), truth), [Part::Yaw]);
            let off = Quat::from_rotation_z(0.4)
                * Quat::from_rotation_x(0.5)
                * Quat::from_rotation_z(-0.4)
                * equivalent;
            assert_eq!(wrong_angles(CODEC, &action(off), truth), [Part::Roll]);
        }
        assert_eq!(degrees_between(CODEC, 71, 1), 10.0, "around the circle");
    }

    #[test]
    fn quantiles_are_values_that_occurred() {
        let found = Quantiles::of((1..=10).rev().map(|i| i as f32).collect());
        assert_eq!((found.median, found.p90), (5.0, 9.0));
        assert_eq!(Quantiles::of(vec![3.0]), Quantiles { median: 3.0, p90: 3.0 });
    }
}
