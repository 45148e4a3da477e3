//! Time until an agent sees a new scene: every task with both robots, and the middle of them all.

use super::{Row, measure};
use crate::cli::failure::Result;
use crate::cli::settings::default_preset;
use lpr_core::config::Config;
use lpr_core::env::Environment as _;
use lpr_core::robot::{ROBOTS, Robot};
use lpr_core::sim::SimEnvironment;
use lpr_core::sim::tasks::{TASKS, Task};
use std::sync::Arc;

/// First scene.
const SCENE: u64 = 2000;

pub(super) fn run() -> Result<Vec<Row>> {
    let config = default_preset();
    let pairs = TASKS.iter().flat_map(|task| ROBOTS.map(|robot| (task, robot)));
    let mut rows: Vec<Row> =
        pairs.map(|(task, robot)| reset(&config, task, robot)).collect::<Result<_>>()?;
    let all = middle(&rows);
    rows.push(all);
    Ok(rows)
}

/// Placement of a new scene, its settling and the first observation.
fn reset(config: &Config, task: &Arc<Task>, robot: &Arc<Robot>) -> Result<Row> {
    let mut env = SimEnvironment::new(task, robot, SCENE, &["front"], &config.simulator)?;
    let mut seed = SCENE;
    Ok(measure(format!("reset_rgbd_{}_{}", task.name, robot.name), || {
        seed += 1;
        env.reset(seed).map(|()| env.observe())
    }))
}

/// The median of the medians.
fn middle(rows: &[Row]) -> Row {
    let sorted = |value: fn(&Row) -> f64| {
        let mut values: Vec<f64> = rows.iter().map(value).collect();
        values.sort_by(f64::total_cmp);
        values
    };
    let [medians, least] = [sorted(|row| row.median_ms), sorted(|row| row.min_ms)];
    let runs = rows.iter().map(|row| row.runs).sum();
    Row {
        name: "reset_rgbd_all".into(),
        threads: rows[0].threads,
        median_ms: medians[medians.len() / 2],
        min_ms: least[0],
        runs,
    }
}
