//! The simulated world that agents are trained, evaluated and shown in.

use super::failure::Result;
use lpr_core::config::Config;
use lpr_core::perception::Camera;
use lpr_core::robot::Robot;
use lpr_core::sim::SimEnvironment;
use lpr_core::sim::tasks::Task;
use std::sync::Arc;

/// The simulator with a configuration's settings.
pub(super) fn simulator(
    task: &Arc<Task>,
    robot: &Arc<Robot>,
    cameras: &[String],
    config: &Config,
) -> Result<SimEnvironment> {
    /// Any scene: every episode is reset to its own.
    const FIRST_SCENE: u64 = 1000;
    let cameras: Vec<_> =
        cameras.iter().map(|name| Camera::known_name(name)).collect::<Result<_, _>>()?;
    let mut environment =
        SimEnvironment::new(task, robot, FIRST_SCENE, &cameras, &config.simulator)?;
    environment.set_timing(config.timing.clone());
    Ok(environment)
}
