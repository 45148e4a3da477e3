//! Kinematics against `tests/golden/fk_*.json`, which `tests/peers/kinematics.py` computes from
//! URDF joint origins.

use super::{JointConfig, PANDA, Robot, XARM7};
use glamx::{DPose3, DQuat, DVec3, Pose3};
use serde::Deserialize;
use std::sync::{Arc, LazyLock};

static FILES: [(&LazyLock<Arc<Robot>>, &str); 2] = [
    (&XARM7, include_str!("../../../tests/golden/fk_xarm7.json")),
    (&PANDA, include_str!("../../../tests/golden/fk_panda.json")),
];

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Record {
    q: JointConfig,
    position: [f64; 3],
    rotation_xyzw: [f64; 4],
}

impl Record {
    fn world_from_flange(&self) -> DPose3 {
        DPose3::from_parts(
            DVec3::from_array(self.position),
            DQuat::from_array(self.rotation_xyzw).normalize(),
        )
    }
}

fn records() -> impl Iterator<Item = (&'static Robot, Vec<Record>)> {
    FILES.into_iter().map(|(robot, json)| {
        let robot: &Robot = robot;
        (robot, serde_json::from_str(json).expect("golden file"))
    })
}

/// Distance in metres and angle in radians.
fn pose_error(a: &DPose3, b: &DPose3) -> (f64, f64) {
    let turn = a.rotation.inverse() * b.rotation;
    let sine = DVec3::new(turn.x, turn.y, turn.z).length();
    (a.translation.distance(b.translation), 2.0 * sine.atan2(turn.w.abs()))
}

#[test]
fn flange_poses_agree_with_the_peer() {
    for (robot, records) in records() {
        assert_eq!(records.len(), 1000);
        for record in records {
            let (distance, angle) =
                pose_error(&robot.flange(&record.q), &record.world_from_flange());
            assert!(
                distance < 1e-7 && angle < 1e-7,
                "{}: {distance} m, {angle} rad at {:?}",
                robot.name,
                record.q
            );
        }
    }
}

#[test]
fn inverse_kinematics_reaches_the_peers_poses() {
    for (robot, records) in records() {
        let n_solved = records.iter().filter(|record| {
            let world_from_grip = record.world_from_flange() * robot.flange_from_grip;
            robot.ik_nearest(&Pose3::from(world_from_grip), &robot.start).is_some_and(|config| {
                let (distance, angle) =
                    pose_error(&robot.flange(&config), &record.world_from_flange());
                distance < 1e-4 && angle < 1e-3 && robot.within_limits(&config)
            })
        });
        let n_solved = n_solved.count();
        assert!(n_solved >= 995, "{}: {n_solved} of 1000", robot.name);
    }
}
