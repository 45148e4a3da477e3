//! A scene for tests of planners, and slow checks of what they find.

use crate::path::joint_path::JointPath;
use crate::robot::{JointConfig, Robot};
use crate::scene::stick_arm::{is_free_by_brute_force, stick_arm};
use crate::scene::{Primitive, Scene};
use glamx::{Pose3, Vec3};

/// Depth that two checks 1/32 rad apart may miss at the arm's reach, metres.
const MISSED: f32 = 0.015;

/// The stick arm's start turned by `turn` about the base's axis.
pub(crate) fn turned(turn: f32) -> JointConfig {
    JointConfig::from_fn(7, |j| if j == 0 { turn } else { stick_arm().start[j] })
}

/// A wall ahead of the arm with a window that is too low for its posture at the start.
pub(crate) fn wall_with_window() -> Scene {
    let block = |center: Vec3, half_extents: Vec3| Primitive::Cuboid {
        world_from_box: Pose3::from_translation(center),
        half_extents,
    };
    Scene::from_primitives(vec![
        block(Vec3::new(0.6, 0.0, 1.05), Vec3::new(0.4, 0.02, 0.45)),
        block(Vec3::new(0.45, 0.0, 0.05), Vec3::new(0.25, 0.02, 0.05)),
        block(Vec3::new(0.25, 0.0, 0.3), Vec3::new(0.05, 0.02, 0.3)),
        block(Vec3::new(0.95, 0.0, 0.3), Vec3::new(0.05, 0.02, 0.3)),
    ])
}

/// True if the arm is nowhere on the path deeper in anything than the checks may miss.
pub(crate) fn is_free_densely(robot: &Robot, scene: &Scene, path: &JointPath) -> bool {
    path.configs().windows(2).all(|pair| {
        let n = f32::ceil(pair[0].distance(&pair[1]) * 128.0).max(1.0) as u16;
        (0..=n).all(|i| {
            is_free_by_brute_force(
                robot,
                scene,
                &pair[0].lerp(&pair[1], f32::from(i) / f32::from(n)),
                -MISSED,
            )
        })
    })
}
