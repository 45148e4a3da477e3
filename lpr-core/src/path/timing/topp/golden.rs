//! Durations against `tests/golden/toppra.json`, which `tests/peers/timing.py` makes.

use super::{SmoothPath, time_optimal};
use crate::path::joint_path::JointPath;
use crate::path::timing::motion_limits::MotionLimits;
use crate::robot::{DOF, JointConfig, PANDA};
use serde::Deserialize;

const GOLDEN: &str = include_str!("../../../../../tests/golden/toppra.json");

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Golden {
    limits: Limits,
    paths: Vec<Record>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Limits {
    velocity: [f64; DOF],
    acceleration: [f64; DOF],
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Record {
    waypoints: Vec<JointConfig>,
    duration_secs: f64,
}

#[test]
fn durations_are_those_of_toppra() {
    let golden: Golden = serde_json::from_str(GOLDEN).expect("golden file");
    assert_eq!(
        golden.limits.acceleration,
        core::array::from_fn(|j| f64::from(PANDA.joints[j].max_acceleration))
    );
    let limits = MotionLimits {
        velocity: golden.limits.velocity,
        acceleration: golden.limits.acceleration,
        jerk: None,
    };
    assert_eq!(golden.paths.len(), 40);
    for (idx, record) in golden.paths.into_iter().enumerate() {
        let path = <SmoothPath>::through(&JointPath::new(record.waypoints).unwrap());
        let ratio =
            time_optimal(&path, &limits, None).unwrap().duration_secs() / record.duration_secs;
        // On toppra's grid limits hold at grid points only, so that it may be a little faster than
        // they allow.
        assert!((0.999..1.05).contains(&ratio), "path {idx}: {ratio} times as long");
    }
}
