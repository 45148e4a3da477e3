//! Motions that the controller plans itself, and their queue.

use crate::wire::{Feedback, FeedbackCode, FeedbackKind};
use core::f64::consts::PI;
use lpr_core::glamx::{DPose3, Pose3};
use lpr_core::path::{JointPath, TimedPath, TimingSettings};
use lpr_core::robot::{JointConfig, XARM7};
use std::collections::VecDeque;

/// Fastest joint of the vendor's client, rad/s; the robot's own limit of 2.14 rad/s applies beside
/// it.
const MAX_JOINT_SPEED: f64 = PI;
/// Greatest acceleration of a joint, rad/s².
const MAX_JOINT_ACCELERATION: f64 = 20.0;
/// Slower than that is that, so that every motion ends; rad/s and rad/s².
const MIN_PACE: f64 = 1e-3;
/// Distance between two configurations of a straight line, metres and radians.
const LINE_STEP: f64 = 0.005;

/// Number of a connection.
pub(super) type ConnectionId = u64;

/// Origin of a request, for the feedback of its motion.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Origin {
    pub(super) connection: ConnectionId,
    pub(super) transaction: u16,
    pub(super) protocol: u16,
}

/// A motion or a wait in the queue.
#[derive(Debug, Clone)]
pub(super) struct Task {
    pub(super) number: u16,
    pub(super) register: u8,
    pub(super) origin: Origin,
    /// Feedback that was asked for when the request came.
    pub(super) mask: u8,
    pub(super) kind: TaskKind,
    /// Seconds since it began.
    elapsed: f64,
    started: bool,
}

#[derive(Debug, Clone)]
pub(super) enum TaskKind {
    Move(TimedPath),
    Wait { secs: f64 },
}

impl Task {
    pub(super) const fn new(
        number: u16,
        register: u8,
        origin: Origin,
        mask: u8,
        kind: TaskKind,
    ) -> Self {
        Self { number, register, origin, mask, kind, elapsed: 0.0, started: false }
    }

    fn duration(&self) -> f64 {
        match &self.kind {
            TaskKind::Move(path) => path.duration_secs(),
            TaskKind::Wait { secs } => *secs,
        }
    }

    pub(super) fn feedback(&self, kind: FeedbackKind, code: FeedbackCode) -> Option<Addressed> {
        let Origin { connection, transaction, protocol } = self.origin;
        let wanted = self.mask & kind as u8 != 0;
        let (register, task) = (self.register, self.number);
        wanted.then_some((
            connection,
            Feedback { transaction, protocol, register, kind, code, task, micros: 0 },
        ))
    }
}

/// Feedback and who gets it.
pub(super) type Addressed = (ConnectionId, Feedback);

/// The queue; its first task runs.
#[derive(Debug, Default)]
pub(super) struct Queue(VecDeque<Task>);

impl Queue {
    pub(super) fn len(&self) -> usize {
        self.0.len()
    }

    pub(super) fn push(&mut self, task: Task) {
        self.0.push_back(task);
    }

    /// Configuration of the arm when everything in the queue is done; none when nothing in it
    /// moves.
    pub(super) fn goal(&self) -> Option<JointConfig> {
        self.0.iter().rev().find_map(|task| match &task.kind {
            TaskKind::Move(path) => Some(*path.path().goal()),
            TaskKind::Wait { .. } => None,
        })
    }

    /// Runs tasks for `dt_secs`; says where the arm is then, if something moved it.
    pub(super) fn advance(
        &mut self,
        dt_secs: f64,
        told: &mut Vec<Addressed>,
    ) -> Option<JointConfig> {
        let (mut left, mut at) = (dt_secs, None);
        while let Some(task) = self.0.front_mut() {
            if !task.started {
                task.started = true;
                told.extend(task.feedback(FeedbackKind::Start, FeedbackCode::Done));
            }
            let step = left.min(task.duration() - task.elapsed);
            task.elapsed += step;
            left -= step;
            if let TaskKind::Move(path) = &task.kind {
                at = Some(path.config_at(task.elapsed));
            }
            if task.elapsed < task.duration() {
                break;
            }
            if let TaskKind::Move(path) = &task.kind {
                at = Some(*path.path().goal());
            }
            told.extend(task.feedback(FeedbackKind::End, FeedbackCode::Done));
            self.0.pop_front();
        }
        at
    }

    /// Forgets every task.
    pub(super) fn discard(&mut self, told: &mut Vec<Addressed>) {
        told.extend(
            self.0
                .drain(..)
                .filter_map(|task| task.feedback(FeedbackKind::End, FeedbackCode::Discarded)),
        );
    }
}

/// The motion in a straight line of the joints whose farthest joint goes at that speed, rad/s, and
/// acceleration, rad/s².
pub(super) fn joint_motion(
    start: JointConfig,
    goal: JointConfig,
    speed: f64,
    acceleration: f64,
) -> TimedPath {
    let path = JointPath::new(vec![start, goal]).expect("both ends were checked to be finite");
    timed(
        path,
        speed.clamp(MIN_PACE, MAX_JOINT_SPEED),
        acceleration.clamp(MIN_PACE, MAX_JOINT_ACCELERATION),
    )
}

/// `path` with the speed and acceleration of its farthest joint, taken from end to end.
fn timed(path: JointPath, speed: f64, acceleration: f64) -> TimedPath {
    let length = f64::from(path.length());
    let farthest: f32 =
        path.configs().windows(2).map(|pair| pair[0].max_joint_distance(&pair[1])).sum();
    let scale = if farthest > 0.0 { length / f64::from(farthest) } else { 1.0 };
    let settings = TimingSettings {
        max_velocity: (speed * scale) as f32,
        max_acceleration: (acceleration * scale) as f32,
    };
    TimedPath::new(path, &XARM7, &settings).expect("the pace is positive")
}

/// The motion of the flange along a straight line; speed in m/s or rad/s, whichever takes longer.
/// None out of reach.
pub(super) fn line_motion(
    start: JointConfig,
    world_from_flange: DPose3,
    speed: f64,
    acceleration: f64,
) -> Option<TimedPath> {
    let from = XARM7.flange(&start);
    let distance = (world_from_flange.translation - from.translation).length();
    let extent = distance.max(from.rotation.angle_between(world_from_flange.rotation));
    let n_steps = (extent / LINE_STEP).ceil().max(1.0) as usize;
    let mut configs = vec![start];
    for step in 1..=n_steps {
        let fraction = step as f64 / n_steps as f64;
        let translation = from.translation.lerp(world_from_flange.translation, fraction);
        let rotation = from.rotation.slerp(world_from_flange.rotation, fraction);
        let world_from_grip = DPose3::from_parts(translation, rotation) * XARM7.flange_from_grip;
        configs
            .push(XARM7.ik_step(&Pose3::from(world_from_grip), configs.last().unwrap_or(&start))?);
    }
    let path = JointPath::new(configs).ok()?;
    // Of the tool to those of the joints, in the mean over the line.
    let scale = f64::from(path.length()) / extent.max(1e-9);
    let pace = |value: f64| (value.max(MIN_PACE) * scale).max(MIN_PACE) as f32;
    TimedPath::new(
        path,
        &XARM7,
        &TimingSettings { max_velocity: pace(speed), max_acceleration: pace(acceleration) },
    )
    .ok()
}
