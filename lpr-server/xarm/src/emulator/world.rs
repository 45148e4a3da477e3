//! The arm and the gripper that an emulated controller commands.

use core::fmt;
use lpr_core::robot::JointConfig;

/// Position of the open gripper, pulses.
pub(super) const OPEN: f64 = 850.0;

/// Arm, gripper and all that is around them, as far as a controller knows of them.
///
/// A controller gives it one [`Setpoint`] for every slice of time, and reports what it reads
/// afterwards: where the arm and the fingers are is for the world to decide, not for the controller.
pub trait World: fmt::Debug + Send {
    /// Lets `dt_secs` pass, at the end of which arm and fingers should be at `setpoint`.
    fn advance(&mut self, dt_secs: f64, setpoint: &Setpoint);

    /// Joint angles, radians.
    fn joints(&self) -> JointConfig;

    /// Position of the fingers, pulses of the vendor's gripper: 0 closed, 850 open.
    fn fingers(&self) -> f64;
}

/// A command to the drives for one slice of time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Setpoint {
    /// Joint angles at its end, radians.
    pub joints: JointConfig,
    /// The command to the fingers.
    pub fingers: Fingers,
}

/// A command to the fingers.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Fingers {
    /// Position to go to, pulses.
    pub target: f64,
    /// Greatest speed on the way, pulses a second.
    pub speed: f64,
}

/// A world in which the arm is where it should be at once, the fingers go at their speed, and
/// nothing is in the way.
#[derive(Debug, Clone, PartialEq)]
pub struct KinematicWorld {
    joints: JointConfig,
    fingers: f64,
}

impl KinematicWorld {
    /// With the arm at `joints` and the gripper open.
    #[must_use]
    pub const fn at(joints: JointConfig) -> Self {
        Self { joints, fingers: OPEN }
    }
}

impl World for KinematicWorld {
    fn advance(&mut self, dt_secs: f64, setpoint: &Setpoint) {
        let Setpoint { joints, fingers: Fingers { target, speed } } = *setpoint;
        self.joints = joints;
        let most = speed * dt_secs;
        self.fingers += (target - self.fingers).clamp(-most, most);
    }

    fn joints(&self) -> JointConfig {
        self.joints
    }

    fn fingers(&self) -> f64 {
        self.fingers
    }
}
