//! Control steps: the arm goes to a joint target within 50 ms, for agents that act at 20 Hz instead
//! of by whole paths.

use super::SimEnvironment;
use crate::env::{InvalidAction, StepResult};
use crate::robot::{Gripper, JointConfig};

/// An arm that is to move less than this stands still, radians in every joint.
const STILL: f32 = 1e-6;
/// Slack of the velocity limit: far more than rounding, and less than what stops a
/// physics step half-way.
const SPEED_SLACK: f32 = 1.001;

/// Action of one control step.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ControlAction {
    /// Configuration at the end of the step, radians.
    pub target: JointConfig,
    /// Command to the gripper, which goes on moving in the steps that follow.
    pub gripper: Gripper,
}

impl SimEnvironment {
    /// One control step ([`SimParams::control_dt`](crate::sim::SimParams::control_dt)): the arm
    /// moves to the target in a straight line of joint space at constant speed, while the gripper
    /// does what it is told.
    ///
    /// A target that is no configuration of the arm or too far away for the joints' velocity limits
    /// ends the episode (`invalid`) before anything has moved: the next step may start from there.
    /// Control steps are no macro actions: they neither count as such nor truncate the episode. The
    /// reward is that of [`Environment::step`](crate::env::Environment::step).
    ///
    /// ```
    /// use lpr_core::robot::{Gripper, XARM7};
    /// use lpr_core::sim::tasks::Task;
    /// use lpr_core::sim::{ControlAction, SimEnvironment, SimParams};
    ///
    /// let task = Task::by_name("reach_target")?;
    /// let mut env = SimEnvironment::new(&task, &XARM7, 7, &[], &SimParams::STANDARD)?;
    /// let mut target = *env.world().config();
    /// target[0] += 0.05;
    /// let result = env.control_step(&ControlAction { target, gripper: Gripper::Open });
    /// assert_eq!((result.invalid, *env.world().config()), (None, target));
    ///
    /// target[0] += 3.0;
    /// let refused = env.control_step(&ControlAction { target, gripper: Gripper::Open });
    /// assert_eq!(refused.invalid.map(|invalid| invalid.name()), Some("joint_speed"));
    /// # Ok::<(), lpr_core::Error>(())
    /// ```
    pub fn control_step(&mut self, action: &ControlAction) -> StepResult {
        let outcome = self.check_target(&action.target).and_then(|()| self.go_to(action));
        let success = outcome.is_ok() && self.world.success();
        StepResult {
            reward: f32::from(u8::from(success)),
            terminated: success || outcome.is_err(),
            truncated: false,
            invalid: outcome.err(),
        }
    }

    fn check_target(&self, target: &JointConfig) -> Result<(), InvalidAction> {
        let world = &self.world;
        // False for what is not a number.
        if !world.robot().within_limits(target) {
            return Err(InvalidAction::OutsideLimits);
        }
        let seconds = world.params().steps_per_control() as f32 * world.params().dt;
        let too_fast = |j: &usize| {
            let most = world.robot().joints[*j].max_velocity * SPEED_SLACK * seconds;
            (target[*j] - world.config()[*j]).abs() > most
        };
        (0..target.len())
            .find(too_fast)
            .map_or(Ok(()), |joint| Err(InvalidAction::JointSpeed { joint }))
    }

    fn go_to(&mut self, action: &ControlAction) -> Result<(), InvalidAction> {
        let ControlAction { target, gripper } = action;
        self.world.command_gripper(*gripper);
        let (start, steps) = (*self.world.config(), self.world.params().steps_per_control());
        let stands = target.max_joint_distance(&start) < STILL;
        for i in 1..=steps {
            // Exactly the target at the end.
            let config =
                if i == steps { *target } else { start.lerp(target, i as f32 / steps as f32) };
            match self.world.step(&config) {
                // As in a macro action: fingers of an arm that stands still press with what their
                // motor gives, at first more.
                Err(InvalidAction::Force { .. }) if stands => {}
                moved => moved?,
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests;
