//! What is compared between wasm and native code: the simulator's results, and its speed.

use lpr_core::env::InvalidAction;
use lpr_core::error::{Error, Result};
use lpr_core::rng::{Stream, stream};
use lpr_core::robot::Robot;
use lpr_core::sim::tasks::Task;
use lpr_core::sim::{ArmSweep, SimEnvironment, SimParams, World, demonstrate};

/// The hash of the world, 16 hexadecimal digits, after the whole scripted demonstration in scene `seed`, done or not.
///
/// # Errors
///
/// When task or robot are unknown, or the scene cannot be placed.
pub fn demonstration_hash(task: &str, robot: &str, seed: u64) -> Result<String> {
    let (task, robot) = (Task::by_name(task)?, Robot::by_name(robot)?);
    let mut environment = SimEnvironment::new(task, robot, seed, &["front"], &SimParams::STANDARD)?;
    let _ = demonstrate(&mut environment, &mut stream(seed, Stream::Demo, 0));
    Ok(hash(environment.world()))
}

/// The scene of the benchmark `physics_arm10_10ms`.
#[derive(Debug)]
pub struct PhysicsBench(ArmSweep);

impl PhysicsBench {
    /// At its start.
    ///
    /// # Errors
    ///
    /// As [`ArmSweep::new`].
    pub fn new() -> Result<Self> {
        ArmSweep::new(&SimParams::STANDARD).map(Self)
    }

    /// Goes on by physics steps; the hash of the world after them.
    ///
    /// # Errors
    ///
    /// As [`ArmSweep::step`].
    pub fn run(&mut self, n_steps: u32) -> Result<String> {
        let broken = |reason: InvalidAction| Error::Environment(reason.to_string());
        (0..n_steps).try_for_each(|_| self.0.step()).map_err(broken)?;
        Ok(hash(self.0.world()))
    }
}

fn hash(world: &World) -> String {
    format!("{:016x}", world.hash())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_demonstration_changes_the_world_and_is_the_same_again() {
        let [once, again] = [(); 2].map(|()| demonstration_hash("reach_target", "panda", 3).unwrap());
        assert_eq!(once, again);
        assert_ne!(once, demonstration_hash("reach_target", "panda", 4).unwrap());
        assert!(demonstration_hash("reach_taget", "panda", 3).unwrap_err().to_string().contains("reach_taget"));
    }

    #[test]
    fn steps_in_two_parts_are_steps_at_once() {
        let [mut parts, mut whole] = [(); 2].map(|()| PhysicsBench::new().unwrap());
        parts.run(7).unwrap();
        assert_eq!(parts.run(5).unwrap(), whole.run(12).unwrap());
    }
}
