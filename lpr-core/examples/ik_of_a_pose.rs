//! Twenty distinct configurations of one pose of the grip.
//!
//! ```text
//! cargo run -p lpr-core --no-default-features --example ik_of_a_pose
//! ```
#![expect(clippy::print_stdout, reason = "an example shows what it found")]

use lpr_core::glamx::{Pose3, Quat, Vec3};
use lpr_core::rng::{Stream, stream};
use lpr_core::robot::XARM7;

/// Configurations asked for.
const N_CONFIGS: usize = 20;

/// Two configurations differ by more than this in some joint, radians.
const MIN_DISTANCE: f32 = 0.2;

fn main() {
    // Half a metre ahead and 20 cm above the table, the gripper pointing down.
    let world_from_grip =
        Pose3::from_parts(Vec3::new(0.5, 0.1, 0.2), Quat::from_rotation_x(core::f32::consts::PI));
    let rng = &mut stream(0, Stream::Ik, 0);
    let configs = XARM7.ik_distinct(&world_from_grip, N_CONFIGS, MIN_DISTANCE, &XARM7.start, rng);
    assert_eq!(configs.len(), N_CONFIGS, "the pose is well within reach");
    println!("joint angles, rad                                             off by, um");
    for config in &configs {
        let off = XARM7.grip(config).translation.distance(world_from_grip.translation);
        let angles: Vec<_> = config.iter().map(|angle| format!("{angle:7.3}")).collect();
        println!("{}    {:.2}", angles.join(" "), 1e6 * off);
        assert!(XARM7.within_limits(config) && off < 1e-4);
    }
    let nearest = XARM7.ik_nearest(&world_from_grip, &XARM7.start).expect("twenty were just found");
    println!("the nearest to the start is {:.3} rad away", nearest.distance(&XARM7.start));
}
