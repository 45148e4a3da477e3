//! Which motions the controller puts into its queue, and how it refuses the others.

use super::{Controller, ERROR_JOINT_LIMIT};
use crate::emulator::motion::{Origin, Task, TaskKind, joint_motion, line_motion};
use crate::wire::{
    Answer, Check, FeedbackCode, FeedbackKind, JointMove, LineForm, LineMove, Mode, Pace, Request,
    State, TcpPose, register,
};
use lpr_core::robot::{DOF, JointConfig, XARM7};

/// Motions that the queue holds.
const QUEUE_CAPACITY: usize = 1024;
/// Error: no inverse kinematics along a line.
const ERROR_KINEMATICS: u8 = 21;
/// Warning: the queue is full.
const WARNING_QUEUE_FULL: u8 = 11;

impl Controller {
    /// Configuration of the arm when the queue is done.
    fn planned(&self) -> JointConfig {
        self.queue.goal().unwrap_or(self.setpoint)
    }

    pub(super) fn queue_motion(&mut self, request: &Request, origin: Origin) -> Option<Answer> {
        let check = check_of(request);
        let check_answer = (check != Check::Absent).then_some(0);
        if self.mode != Mode::POSITION {
            return None;
        }
        if self.queue.len() >= QUEUE_CAPACITY {
            self.warning = WARNING_QUEUE_FULL;
            return None;
        }
        // The bits of the reply say that it was not queued.
        if !self.can_move() {
            return Some(Answer::Queued(0, check_answer));
        }
        let kind = match self.plan(request) {
            Ok(kind) => kind,
            Err(PlanError::Malformed) => return None,
            Err(PlanError::Code(code)) if check == Check::Only => {
                return Some(Answer::Queued(0, Some(code)));
            }
            Err(PlanError::Code(code)) => {
                self.raise(code);
                return Some(Answer::Queued(0, check_answer));
            }
        };
        if check == Check::Only {
            return Some(Answer::Queued(self.queue.len() as u16, check_answer));
        }
        let task = self.task(request.register(), origin, kind);
        self.queue.push(task);
        if self.state == State::Ready {
            self.state = State::Moving;
        }
        Some(Answer::Queued(self.queue.len() as u16, check_answer))
    }

    /// Tells when the queue gets there: at once where nothing moves.
    pub(super) fn check_feedback(&mut self, origin: Origin) -> Answer {
        let task = self.task(register::FEEDBACK_CHECK, origin, TaskKind::Wait { secs: 0.0 });
        if self.queue.len() == 0 {
            self.told.extend(task.feedback(FeedbackKind::End, FeedbackCode::Done));
        } else {
            self.queue.push(task);
        }
        Answer::Done
    }

    fn task(&mut self, register: u8, origin: Origin, kind: TaskKind) -> Task {
        let number = self.next_task;
        self.next_task = self.next_task.wrapping_add(1).max(1);
        Task::new(number, register, origin, self.feedback_mask, kind)
    }

    fn plan(&self, request: &Request) -> Result<TaskKind, PlanError> {
        let plan =
            |target, speed, acceleration| plan_joints(self.planned(), target, speed, acceleration);
        match request {
            Request::MoveJoints(JointMove {
                target,
                pace: Pace { speed, acceleration, .. },
                ..
            }) => plan(target, *speed, *acceleration),
            Request::MoveJointsBlended { target, speed, acceleration, .. } => {
                plan(target, *speed, *acceleration)
            }
            Request::MoveHome(Pace { speed, acceleration, .. }) => {
                plan(&[Some(0.0); DOF], *speed, *acceleration)
            }
            Request::MoveLine(line) => self.plan_line(line, self.planned()),
            Request::Sleep(secs) if secs.is_finite() && *secs >= 0.0 => {
                Ok(TaskKind::Wait { secs: f64::from(*secs) })
            }
            _ => Err(PlanError::Malformed),
        }
    }

    fn plan_line(
        &self,
        LineMove { target, pace, form }: &LineMove,
        start: JointConfig,
    ) -> Result<TaskKind, PlanError> {
        let TcpPose { position, rpy } = self.tcp_at(&start);
        let current = [position, rpy].concat();
        let numbers: [f64; 6] = core::array::from_fn(|i| target[i].unwrap_or(current[i]));
        let [x, y, z, roll, pitch, yaw] = numbers;
        let is_plain = !matches!(
            form,
            LineForm::Common { frame: 1.., .. } | LineForm::Common { rotation: 1.., .. }
        );
        if !is_plain
            || !numbers
                .iter()
                .chain([&pace.speed, &pace.acceleration])
                .all(|number| number.is_finite())
        {
            return Err(PlanError::Malformed);
        }
        let goal = self.flange_of(TcpPose { position: [x, y, z], rpy: [roll, pitch, yaw] });
        let motion = line_motion(start, goal, pace.speed, pace.acceleration);
        motion.map(TaskKind::Move).ok_or(PlanError::Code(ERROR_KINEMATICS))
    }
}

/// Reason why a motion is not queued.
enum PlanError {
    /// Numbers that are none, or a form of motion that is not emulated.
    Malformed,
    /// Number of the error that a controller stops with.
    Code(u8),
}

fn plan_joints(
    start: JointConfig,
    target: &[Option<f32>; DOF],
    speed: f64,
    acceleration: f64,
) -> Result<TaskKind, PlanError> {
    let goal = JointConfig::from_fn(DOF, |j| target[j].unwrap_or(start[j]));
    if !(goal.is_finite() && speed.is_finite() && acceleration.is_finite()) {
        return Err(PlanError::Malformed);
    }
    if !XARM7.within_limits(&goal) {
        return Err(PlanError::Code(ERROR_JOINT_LIMIT));
    }
    Ok(TaskKind::Move(joint_motion(start, goal, speed, acceleration)))
}

const fn check_of(request: &Request) -> Check {
    match request {
        Request::MoveJoints(JointMove { check, .. }) => *check,
        Request::MoveLine(LineMove { form: LineForm::Common { check, .. }, .. }) => *check,
        _ => Check::Absent,
    }
}
