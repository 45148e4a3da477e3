//! A scene of your own from JSON, and a demonstration in its physics: a block is picked up.
//!
//! ```text
//! cargo run -p lpr-core --no-default-features --features sim --example task_from_json
//! ```
#![expect(clippy::print_stdout, reason = "an example shows what it found")]

use lpr_core::env::InvalidAction;
use lpr_core::glamx::{Pose3, Quat, Vec3};
use lpr_core::path::{TimedPath, TimingSettings, linear_path};
use lpr_core::robot::{Gripper, XARM7};
use lpr_core::sim::{SceneSpec, SimParams, World};
use std::sync::Arc;

/// Poses are quaternion (xyzw) and translation, metres, in the world, whose origin is the base of
/// the arm on the table; `padding` is there because glamx writes it.
const SCENE: &str = r#"{
    "task": "pick_up_block",
    "bodies": [
        {"name": "table", "kind": "fixed", "mass": 0.0, "friction": 0.6,
         "pose": {"rotation": [0, 0, 0, 1], "translation": [0.5, 0.0, -0.02], "padding": 0},
         "parts": [{"shape": {"cuboid": {"half_extents": [0.4, 0.5, 0.02]}}, "rgb": [120, 90, 60],
                    "pose": {"rotation": [0, 0, 0, 1], "translation": [0, 0, 0], "padding": 0}}]},
        {"name": "block", "kind": "graspable", "mass": 0.1, "friction": 0.8,
         "pose": {"rotation": [0, 0, 0, 1], "translation": [0.45, 0.1, 0.025], "padding": 0},
         "parts": [{"shape": {"cuboid": {"half_extents": [0.02, 0.02, 0.025]}}, "rgb": [200, 30, 30],
                    "pose": {"rotation": [0, 0, 0, 1], "translation": [0, 0, 0], "padding": 0}}]}
    ],
    "joints": [],
    "success": [
        {"grasped": {"body": 1}},
        {"body_in_zone": {"body": 1, "point": [0, 0, 0],
                          "zone": {"cylinder": {"center": [0.45, 0.1, 0.2], "radius": 0.05, "half_height": 0.08}}}}
    ]
}"#;

const TIMING: TimingSettings = TimingSettings { max_velocity: 1.0, max_acceleration: 4.0 };

/// Waypoints of the grip: height over the block, and the gripper's command there.
const WAYPOINTS: [(f32, Gripper); 3] =
    [(0.15, Gripper::Open), (0.025, Gripper::Close), (0.2, Gripper::Close)];

fn main() -> Result<(), Box<dyn core::error::Error>> {
    let spec: SceneSpec = serde_json::from_str(SCENE)?;
    spec.check()?;
    let mut world = World::new(Arc::new(spec), &XARM7, XARM7.start, &SimParams::STANDARD)?;
    for (height, gripper) in WAYPOINTS {
        let pose = Pose3::from_parts(
            Vec3::new(0.45, 0.1, height),
            Quat::from_rotation_x(core::f32::consts::PI),
        );
        let path = linear_path(&XARM7, world.config(), &pose)
            .map_err(|reason| format!("no path: {}", reason.name()))?;
        let timed = TimedPath::new(path, &XARM7, &TIMING)?;
        follow(&mut world, &timed, gripper).map_err(|reason| reason.to_string())?;
        println!(
            "block at {:.3} m, task done: {}",
            world.body_pose(1).translation,
            world.success()
        );
    }
    assert!(world.success(), "the block is held above the table");
    Ok(())
}

/// Drives the arm along the path, then gives the gripper its command and waits until it is done.
fn follow(world: &mut World, timed: &TimedPath, gripper: Gripper) -> Result<(), InvalidAction> {
    let dt = f64::from(world.params().dt);
    let n_steps = (timed.duration_secs() / dt) as u32 + 1;
    (1..=n_steps).try_for_each(|step| world.step(&timed.config_at(f64::from(step) * dt)))?;
    world.command_gripper(gripper);
    loop {
        world.step(timed.path().goal())?;
        if world.gripper_settled() {
            return Ok(());
        }
    }
}
