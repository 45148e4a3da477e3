//! Macro actions: the arm follows a whole path, then the gripper does what it is told.

use super::SimEnvironment;
use crate::env::{EPISODE_LENGTH, InvalidAction, StepResult};
use crate::path::{JointPath, TimedPath};
use crate::robot::Gripper;
use crate::sim::world::World;

/// Longest time a gripper command may take, seconds: fingers that meet an object off their middle
/// push it along slowly.
const GRIPPER_TIMEOUT_SECS: f32 = 5.0;
/// Longest motion, seconds: a path of many turns would run for hours.
const MOTION_TIMEOUT_SECS: f64 = 120.0;
/// A path must start this close to where the arm is, radians in every joint.
const START_TOLERANCE: f32 = 1e-3;

/// End of a macro action.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(in crate::sim) enum Until {
    /// As soon as the task is done, or at the end.
    Success,
    /// At the end.
    End,
}

impl SimEnvironment {
    /// One macro action; a simulator never fails.
    pub fn step(&mut self, path: &JointPath, gripper: Gripper) -> StepResult {
        self.step_recorded(path, gripper, |_| {})
    }

    /// As [`Self::step`], calling `record` after every control step and after the gripper's
    /// command.
    pub fn step_recorded(
        &mut self,
        path: &JointPath,
        gripper: Gripper,
        record: impl FnMut(&World),
    ) -> StepResult {
        self.step_until(Until::Success, path, gripper, record)
    }

    /// As [`Self::step_recorded`], stopping where `until` says.
    pub(in crate::sim) fn step_until(
        &mut self,
        until: Until,
        path: &JointPath,
        gripper: Gripper,
        mut record: impl FnMut(&World),
    ) -> StepResult {
        self.step += 1;
        let outcome = self.run(until, path, gripper, &mut record);
        let success = outcome.is_ok() && self.world.success();
        let terminated = success || outcome.is_err();
        StepResult {
            reward: f32::from(u8::from(success)),
            terminated,
            truncated: !terminated && self.step >= EPISODE_LENGTH,
            invalid: outcome.err(),
        }
    }

    /// Follows the path, then moves the gripper.
    fn run(
        &mut self,
        until: Until,
        path: &JointPath,
        gripper: Gripper,
        record: &mut impl FnMut(&World),
    ) -> Result<(), InvalidAction> {
        if path.start().max_joint_distance(self.world.config()) > START_TOLERANCE {
            return Err(InvalidAction::StartMismatch);
        }
        if !path.configs().iter().all(|config| self.robot.within_limits(config)) {
            return Err(InvalidAction::OutsideLimits);
        }
        let timed = TimedPath::new(path.clone(), &self.robot, &self.timing)
            .expect("the environment's timing is positive");
        if timed.duration_secs() > MOTION_TIMEOUT_SECS {
            return Err(InvalidAction::TooLong { seconds: timed.duration_secs() as f32 });
        }
        // The last step may reach beyond the path's end: the path then stands at its goal.
        let dt = f64::from(self.params.dt);
        let steps = libm::ceil(timed.duration_secs() / dt) as usize;
        let per_control = self.params.steps_per_control();
        for i in 1..=steps {
            self.world.step(&timed.config_at(i as f64 * dt))?;
            if i % per_control == 0 || i == steps {
                record(&self.world);
                if until == Until::Success && self.world.success() {
                    return Ok(());
                }
            }
        }
        self.move_gripper(gripper)?;
        record(&self.world);
        Ok(())
    }

    /// The arm moves to `config` within one control step.
    #[cfg(feature = "learn")]
    pub(in crate::sim) fn move_straight(
        &mut self,
        config: &crate::robot::JointConfig,
    ) -> Result<(), InvalidAction> {
        let (start, steps) = (*self.world.config(), self.params.steps_per_control());
        (1..=steps).try_for_each(|i| self.world.step(&start.lerp(config, i as f32 / steps as f32)))
    }

    pub(in crate::sim) fn move_gripper(&mut self, gripper: Gripper) -> Result<(), InvalidAction> {
        self.world.command_gripper(gripper);
        let config = *self.world.config();
        let most = (GRIPPER_TIMEOUT_SECS / self.params.dt) as usize;
        for i in 0..most {
            match self.world.step(&config) {
                // The arm stands still: its fingers press with what the gripper's motor gives,
                // which overshoots at first.
                Ok(()) | Err(InvalidAction::Force { .. }) => {}
                Err(invalid) => return Err(invalid),
            }
            if self.world.gripper_settled() && i >= self.params.steps_per_control() {
                break;
            }
        }
        Ok(())
    }
}
