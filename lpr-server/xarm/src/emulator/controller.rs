//! The controller's state machine: a value that time and requests change, without a clock or a
//! socket of its own.
//!
//! # Differences from a controller
//!
//! - A stop takes effect at once, without slowing down.
//! - Blend radii are ignored: every motion of the queue ends at rest.
//! - Settings that change nothing here (limits of reduced mode, fences, outputs) are acknowledged
//!   and kept nowhere.
//! - Neither speeds of a servo stream nor collisions raise errors; leaving the joint limits does
//!   (23).

mod queueing;
mod reporting;
#[cfg(test)]
mod tests;

use super::gripper::Gripper;
use super::motion::{Addressed, Origin, Queue};
use super::world::{Setpoint, World};
use crate::wire::{
    Answer, Axis, Feedback, Mode, Power, Reply, Request, State, StateCommand, Status, TcpPose,
    register,
};
use lpr_core::glamx::{DPose3, Pose3};
use lpr_core::robot::{DOF, JointConfig, XARM7};

/// Fastest joint in servo mode, rad/s.
const SERVO_SPEED: f64 = core::f64::consts::PI;
/// The tool's serial line runs at 2,000,000 baud.
const TOOL_BAUD_ADDRESS: u16 = 0x0a0b;
const TOOL_BAUD_INDEX: i32 = 11;

/// Error: a joint limit.
const ERROR_JOINT_LIMIT: u8 = 23;
/// Warning: a parameter that cannot be.
const WARNING_PARAMETER: u8 = 12;
/// Warning: a register that does not exist.
const WARNING_UNKNOWN: u8 = 13;

/// Registers that are acknowledged and change nothing here.
const ACKNOWLEDGED: [u8; 22] = [
    18,
    39,
    40,
    47,
    48,
    50,
    51,
    52,
    58,
    59,
    60,
    66,
    70,
    73,
    74,
    75,
    77,
    78,
    79,
    80,
    register::WRITE_TOOL_16,
    146,
];

/// The controller, and the world of its arm.
#[derive(Debug)]
pub(super) struct Controller {
    firmware: String,
    /// Seconds since it was switched on.
    time: f64,
    world: Box<dyn World>,
    /// Configuration in which the joints should be now.
    setpoint: JointConfig,
    /// Measured, rad/s.
    speeds: [f32; DOF],
    state: State,
    mode: Mode,
    drives: Power,
    error: u8,
    warning: u8,
    feedback_mask: u8,
    next_task: u16,
    queue: Queue,
    servo_target: Option<JointConfig>,
    told: Vec<Addressed>,
    flange_from_tcp: TcpPose,
    collision_sensitivity: u8,
    teach_sensitivity: u8,
    gripper: Gripper,
}

impl Controller {
    /// Switched on and stopped.
    pub(super) fn new(firmware: &str, world: Box<dyn World>) -> Self {
        Self {
            firmware: firmware.to_owned(),
            time: 0.0,
            setpoint: world.joints(),
            world,
            speeds: [0.0; DOF],
            state: State::Stopped,
            mode: Mode::POSITION,
            drives: Power::Off,
            error: 0,
            warning: 0,
            feedback_mask: 0,
            next_task: 1,
            queue: Queue::default(),
            servo_target: None,
            told: Vec::new(),
            flange_from_tcp: TcpPose { position: [0.0; 3], rpy: [0.0; 3] },
            collision_sensitivity: 3,
            teach_sensitivity: 3,
            gripper: Gripper::new(),
        }
    }

    /// Lets `dt_secs` pass.
    pub(super) fn advance(&mut self, dt_secs: f64) {
        self.time += dt_secs;
        let before = self.world.joints();
        if matches!(self.state, State::Moving | State::Ready) {
            if self.mode == Mode::SERVO {
                self.follow_servo(dt_secs);
            } else {
                self.follow_queue(dt_secs);
            }
        }
        let setpoint = Setpoint { joints: self.setpoint, fingers: self.gripper.fingers() };
        self.world.advance(dt_secs, &setpoint);
        if dt_secs > 0.0 {
            let after = self.world.joints();
            self.speeds = core::array::from_fn(|j| {
                ((f64::from(after[j]) - f64::from(before[j])) / dt_secs) as f32
            });
        }
    }

    fn follow_servo(&mut self, dt_secs: f64) {
        let Some(target) = self.servo_target else { return };
        let most = (SERVO_SPEED * dt_secs) as f32;
        for (joint, target) in self.setpoint.iter_mut().zip(target.iter()) {
            // Exactly there, not there but for rounding.
            *joint = if (target - *joint).abs() <= most {
                *target
            } else {
                *joint + (target - *joint).clamp(-most, most)
            };
        }
        self.state = if self.setpoint == target { State::Ready } else { State::Moving };
    }

    fn follow_queue(&mut self, dt_secs: f64) {
        if let Some(at) = self.queue.advance(dt_secs, &mut self.told) {
            self.setpoint = at;
        }
        self.state = if self.queue.len() == 0 { State::Ready } else { State::Moving };
    }

    /// Feedback since the last call, and who gets it.
    pub(super) fn take_told(&mut self) -> Vec<Addressed> {
        let micros = self.micros();
        let told = core::mem::take(&mut self.told);
        told.into_iter()
            .map(|(connection, feedback)| (connection, Feedback { micros, ..feedback }))
            .collect()
    }

    const fn micros(&self) -> u64 {
        (self.time * 1e6) as u64
    }

    /// The bits of every reply.
    pub(super) fn status(&self) -> Status {
        let ready = if self.can_move() { 0 } else { Status::NOT_READY };
        let warning = if self.warning == 0 { 0 } else { Status::WARNING };
        let error = if self.error == 0 { 0 } else { Status::ERROR };
        Status(ready | warning | error)
    }

    fn can_move(&self) -> bool {
        !matches!(self.state, State::Stopped | State::Reconfigured)
    }

    /// Answers a request.
    pub(super) fn answer(&mut self, request: &Request, origin: Origin) -> Reply {
        match self.try_answer(request, origin) {
            Some(answer) => Reply { status: self.status(), answer },
            None => self.refuse(),
        }
    }

    /// Answers what makes no sense.
    pub(super) fn refuse_malformed(&mut self) -> Reply {
        self.warning = WARNING_PARAMETER;
        self.refuse()
    }

    fn refuse(&self) -> Reply {
        Reply { status: Status(self.status().0 | Status::INVALID), answer: Answer::Done }
    }

    /// None when the request is refused.
    fn try_answer(&mut self, request: &Request, origin: Origin) -> Option<Answer> {
        Some(match request {
            Request::GetVersion => Answer::Text(format!("7,7,XI1304,AC1304,v{}", self.firmware)),
            Request::GetSerial => Answer::Text("XI1304EMULATOR\0AC1304EMULATOR\n".to_owned()),
            Request::GetState => Answer::State(self.state),
            Request::GetCommandCount => Answer::Count(self.queue.len() as u16),
            Request::GetError => Answer::Codes(self.error, self.warning),
            Request::GetTcpPose => Answer::Pose(self.tcp()),
            Request::GetJoints(n) => self.joint_groups(n.unwrap_or(1))?,
            Request::GetJointTorques => Answer::Joints(vec![[0.0; DOF]]),
            Request::GetFk(joints) => Answer::Pose(self.tcp_at(joints)),
            Request::GetIk(pose) => self.ik(*pose)?,
            Request::IsJointLimit(joints) => Answer::Flag(u8::from(!XARM7.within_limits(joints))),
            Request::Rs485(rtu) => {
                let answer = self.gripper.answer(rtu, self.world.fingers())?;
                Answer::Rs485(answer)
            }
            Request::ReadTool { address, .. } => {
                Answer::Value(if *address == TOOL_BAUD_ADDRESS { TOOL_BAUD_INDEX } else { 0 })
            }
            Request::Other { register: register::GET_TOOL_ERROR, .. } => Answer::Codes(0, 0),
            Request::MoveJoints(_)
            | Request::MoveJointsBlended { .. }
            | Request::MoveHome(_)
            | Request::MoveLine(_)
            | Request::Sleep(_) => return self.queue_motion(request, origin),
            Request::FeedbackCheck => self.check_feedback(origin),
            Request::ServoJoints(joints, _) => return self.servo(joints),
            Request::SetFeedback(mask) => {
                self.feedback_mask = *mask;
                Answer::Done
            }
            _ => return self.configure(request),
        })
    }

    /// Requests that change what the controller is.
    fn configure(&mut self, request: &Request) -> Option<Answer> {
        match request {
            Request::EnableMotion(axis, power) => self.enable(*axis, *power),
            Request::SetMode(mode, _) => return self.set_mode(*mode),
            Request::SetState(command) => self.set_state(*command),
            Request::CleanError => {
                self.error = 0;
                self.reconfigured();
            }
            Request::CleanWarning => self.warning = 0,
            Request::SetTcpOffset(offset) => {
                self.flange_from_tcp = *offset;
                self.reconfigured();
            }
            Request::Other { register: register::SET_COLLISION_SENSITIVITY, params } => {
                self.collision_sensitivity = *params.first().filter(|level| **level <= 5)?;
                self.reconfigured();
            }
            Request::Other { register: register::SET_TEACH_SENSITIVITY, params } => {
                self.teach_sensitivity =
                    *params.first().filter(|level| (1..=5).contains(*level))?;
                self.reconfigured();
            }
            Request::Other {
                register:
                    register::SET_TCP_JERK..=register::SET_JOINT_ACCELERATION | register::SET_LOAD,
                ..
            } => return Some(Answer::Queued(self.queue.len() as u16, None)),
            request if ACKNOWLEDGED.contains(&request.register()) => {}
            _ => {
                self.warning = WARNING_UNKNOWN;
                return None;
            }
        }
        Some(Answer::Done)
    }

    fn enable(&mut self, axis: Axis, power: Power) {
        if axis == Axis::ALL {
            self.drives = power;
        }
        self.reconfigured();
        if self.drives == Power::Off {
            self.state = State::Stopped;
        }
    }

    fn set_mode(&mut self, mode: Mode) -> Option<Answer> {
        if ![Mode::POSITION, Mode::SERVO].contains(&mode) {
            self.warning = WARNING_PARAMETER;
            return None;
        }
        self.mode = mode;
        self.reconfigured();
        Some(Answer::Done)
    }

    fn set_state(&mut self, command: StateCommand) {
        match command {
            StateCommand::Run if self.error == 0 && self.drives == Power::On => {
                self.state = State::Ready;
            }
            StateCommand::Run => {}
            StateCommand::Pause if self.can_move() => self.state = State::Paused,
            StateCommand::Pause => {}
            StateCommand::Stop | StateCommand::SlowStop => self.stop(State::Stopped),
        }
    }

    /// Nothing moves until the state is set to run.
    fn reconfigured(&mut self) {
        self.stop(State::Reconfigured);
    }

    fn stop(&mut self, state: State) {
        self.queue.discard(&mut self.told);
        self.servo_target = None;
        // The next motion begins where the arm is, which may not be where it should have been.
        self.setpoint = self.world.joints();
        self.speeds = [0.0; DOF];
        self.state = state;
    }

    /// Stops with an error.
    pub(super) fn raise(&mut self, error: u8) {
        self.stop(State::Stopped);
        self.error = error;
    }

    /// The newest point of a servo stream.
    fn servo(&mut self, target: &JointConfig) -> Option<Answer> {
        if self.mode != Mode::SERVO || !target.is_finite() {
            return None;
        }
        if self.can_move() {
            if XARM7.within_limits(target) {
                self.servo_target = Some(*target);
                self.state = State::Moving;
            } else {
                self.raise(ERROR_JOINT_LIMIT);
            }
        }
        Some(Answer::Done)
    }

    /// Positions, then velocities, then torques.
    fn joint_groups(&self, n: u8) -> Option<Answer> {
        let groups = [self.world.joints().to_array(), self.speeds, [0.0; DOF]];
        Some(Answer::Joints(groups.get(..usize::from(n & 0x0f))?.to_vec()))
    }

    fn tcp(&self) -> TcpPose {
        self.tcp_at(&self.world.joints())
    }

    fn tcp_at(&self, joints: &JointConfig) -> TcpPose {
        TcpPose::from(XARM7.flange(joints) * DPose3::from(self.flange_from_tcp))
    }

    fn flange_of(&self, tcp: TcpPose) -> DPose3 {
        DPose3::from(tcp) * DPose3::from(self.flange_from_tcp).inverse()
    }

    fn ik(&self, tcp: TcpPose) -> Option<Answer> {
        let world_from_grip = self.flange_of(tcp) * XARM7.flange_from_grip;
        let config = XARM7.ik_nearest(&Pose3::from(world_from_grip), &self.world.joints())?;
        Some(Answer::Joints(vec![config.to_array()]))
    }
}
