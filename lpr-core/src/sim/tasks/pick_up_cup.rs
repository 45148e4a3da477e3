//! Pick up the cup of one colour by its rim.

use super::builder::{SceneBuilder, Spots, cylinder_z, grip_pose, tube, words};
use super::{Approach, Placement, SceneSource, Task, TaskScene, TaskSet};
use crate::rng::Rng;
use crate::robot::Gripper;
use crate::sim::scene::{Condition, Zone};
use glamx::{Pose3, Vec2, Vec3};
use rand::RngExt as _;

/// The task.
pub(super) fn pick_up_cup() -> Task {
    Task {
        name: "pick_up_cup".to_owned(),
        set: TaskSet::One,
        goal: "pick up the {} cup".to_owned(),
        variations: words(["red", "green", "blue", "yellow", "purple", "white"]),
        keyframes: 3,
        placement: Placement { center: Vec2::ZERO, half_range: Vec2::ZERO, max_yaw: 0.0 },
        scenes: SceneSource::Drawn(build),
    }
}

const RADIUS: f32 = 0.0465;
const HEIGHT: f32 = 0.147;
const WALL: f32 = 0.006;
const MASS: f32 = 0.053;
/// Cups stand in a rectangle of these sides, this far apart, metres: two hands' widths, as one
/// finger goes around the rim.
const REGION: Vec2 = Vec2::new(0.4, 0.6);
const MIN_DISTANCE: f32 = 0.16;
/// Middle of the wall where it is grasped.
const RIM: f32 = RADIUS - 0.5 * WALL;

/// Colours of the variations; the other cup has one of the others.
const COLORS: [[u8; 3]; 6] =
    [[215, 40, 36], [40, 160, 60], [40, 80, 210], [230, 200, 40], [150, 60, 180], [240, 240, 240]];

fn build(variation: usize, rng: &mut Rng) -> TaskScene {
    let mut scene = SceneBuilder::new();
    let mut spots = Spots::new(REGION, MIN_DISTANCE);
    let color = COLORS[variation];
    let others: Vec<_> = COLORS.into_iter().filter(|other| *other != color).collect();
    let other = others[rng.random_range(0..others.len())];
    let [target, _] = [("cup", color), ("other_cup", other)].map(|(name, rgb)| {
        let at = spots.draw(rng).extend(0.0);
        let mut parts = tube(RADIUS, WALL, HEIGHT, rgb);
        parts.push(cylinder_z([0.0, 0.0, 0.5 * WALL], RADIUS - WALL, WALL, rgb));
        (scene.graspable_body(name, Pose3::from_translation(at), MASS, parts), at)
    });
    let (cup, at) = target;
    let down = |height: f32| grip_pose([at.x, at.y + RIM, height], [180.0, 0.0, 0.0]);
    scene.waypoint(down(0.19), Gripper::Open, Approach::Free);
    scene.waypoint(down(0.128), Gripper::Close, Approach::Linear);
    scene.waypoint(down(0.379), Gripper::Close, Approach::Linear);
    let zone = Zone::Cuboid {
        pose: Pose3::from_translation(at),
        half_extents: Vec3::new(0.05, 0.05, 0.025),
    };
    scene.finish(vec![
        Condition::Grasped { body: cup },
        Condition::BodyOutsideZone { body: cup, point: Vec3::ZERO, zone },
    ])
}
