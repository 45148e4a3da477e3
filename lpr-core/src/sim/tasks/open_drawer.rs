//! Open the bottom drawer of a chest: a free slide, pulled by a horizontal bar.

use super::builder::{SceneBuilder, cuboid, cylinder_x, grip_pose};
use super::{Motion, Placement, Task, TaskScene, TaskSet};
use crate::rng::Rng;
use crate::robot::Gripper;
use crate::scene::Part;
use crate::sim::scene_spec::{BodyKind, Condition, JointKind, JointSpec};
use core::f32::consts::FRAC_PI_8;
use glamx::{Vec2, Vec3};

/// The task.
pub(super) static OPEN_DRAWER: Task = Task {
    name: "open_drawer",
    set: TaskSet::Two,
    description: "open the bottom drawer",
    keyframes: 3,
    placement: Placement { center: Vec2::new(0.0, -0.32), half_range: Vec2::new(0.06, 0.12), max_yaw: FRAC_PI_8 },
    build,
};

/// Frame: width x, depth y, height z; it stands on legs.
const FRAME: [f32; 3] = [0.379, 0.383, 0.377];
const LEG_HEIGHT: f32 = 0.093;
const PANEL: f32 = 0.0075;
/// Drawer box: width, depth, height.
const DRAWER: [f32; 3] = [0.361, 0.367, 0.112];
const DRAWER_WALL: f32 = 0.007;
/// Heights of the handles, bottom to top.
const HANDLE_Z: [f32; 3] = [0.163, 0.283, 0.403];
/// The handle bar's axis along y.
const HANDLE_Y: f32 = 0.206;
const HANDLE_RADIUS: f32 = 0.0075;
const HANDLE_LENGTH: f32 = 0.075;
/// Front face of the drawers along y.
const FRONT_Y: f32 = 0.185;
/// Pull at which the task is done, metres.
const OPEN: f32 = 0.15;

const WOOD: [u8; 3] = [150, 105, 70];
const DRAWER_RGB: [u8; 3] = [188, 146, 102];
const METAL: [u8; 3] = [60, 60, 66];

fn build(_: &mut Rng) -> TaskScene {
    let mut scene = SceneBuilder::new(OPEN_DRAWER.name);
    let frame = scene.body("chest", BodyKind::Fixed, Vec3::ZERO, 0.0, frame_parts());
    let mut bottom = 0;
    for (name, z) in ["bottom_drawer", "middle_drawer", "top_drawer"].into_iter().zip(HANDLE_Z) {
        let drawer = scene.body(name, BodyKind::Dynamic, Vec3::new(0.0, 0.0, z), 0.34, drawer_parts());
        let slide = scene.joint(JointSpec {
            name: format!("{name}_slide"),
            kind: JointKind::Prismatic,
            parent: frame,
            child: drawer,
            anchor: Vec3::new(0.0, HANDLE_Y, z),
            axis: Vec3::Y,
            limits: [0.0, 0.30],
            start: 0.0,
            brake: 0.0,
        });
        if z == HANDLE_Z[0] {
            bottom = slide;
        }
    }
    let z = HANDLE_Z[0];
    scene.waypoint(grip_pose([0.0, 0.2825, z], [90.0, 0.0, 0.0]), Gripper::Open, Motion::Free);
    scene.waypoint(grip_pose([0.0, HANDLE_Y, z], [90.0, 0.0, 0.0]), Gripper::Close, Motion::Linear);
    scene.waypoint(grip_pose([0.0, 0.4325, z], [90.0, 0.0, 0.0]), Gripper::Close, Motion::Linear);
    scene.finish(vec![Condition::JointMoved { joint: bottom, min: OPEN }])
}

fn frame_parts() -> Vec<Part> {
    let [width, depth, height] = FRAME;
    let middle = LEG_HEIGHT + 0.5 * height;
    let side = 0.5 * (width - PANEL);
    let mut parts = vec![
        cuboid([side, 0.0, middle], [PANEL, depth, height], WOOD),
        cuboid([-side, 0.0, middle], [PANEL, depth, height], WOOD),
        cuboid([0.0, 0.5 * (PANEL - depth), middle], [width, PANEL, height], WOOD),
        cuboid([0.0, 0.0, LEG_HEIGHT + 0.5 * PANEL], [width, depth, PANEL], WOOD),
        cuboid([0.0, 0.0, LEG_HEIGHT + height - 0.5 * PANEL], [width, depth, PANEL], WOOD),
    ];
    for x in [-1.0, 1.0] {
        for y in [-1.0, 1.0] {
            let leg = [x * (0.5 * width - 0.015), y * (0.5 * depth - 0.015), 0.5 * LEG_HEIGHT];
            parts.push(cuboid(leg, [0.03, 0.03, LEG_HEIGHT], WOOD));
        }
    }
    parts
}

/// A drawer around its handle's height: floor, four walls, the bar and its two posts.
fn drawer_parts() -> Vec<Part> {
    let [width, depth, height] = DRAWER;
    let back = FRONT_Y - depth;
    let middle = 0.5 * (FRONT_Y + back);
    let post = 0.5 * (FRONT_Y + HANDLE_Y);
    let wall = DRAWER_WALL;
    let mut parts = vec![
        cuboid([0.0, FRONT_Y - 0.5 * wall, 0.0], [width, wall, height], DRAWER_RGB),
        cuboid([0.0, back + 0.5 * wall, 0.0], [width, wall, height], DRAWER_RGB),
        cuboid([0.5 * (width - wall), middle, 0.0], [wall, depth, height], DRAWER_RGB),
        cuboid([0.5 * (wall - width), middle, 0.0], [wall, depth, height], DRAWER_RGB),
        cuboid([0.0, middle, 0.5 * (wall - height)], [width, depth, wall], DRAWER_RGB),
        cylinder_x([0.0, HANDLE_Y, 0.0], HANDLE_RADIUS, HANDLE_LENGTH, METAL),
    ];
    for side in [-1.0, 1.0] {
        let x = side * 0.5 * (HANDLE_LENGTH - 0.008);
        parts.push(cuboid([x, post, 0.0], [0.008, HANDLE_Y - FRONT_Y, 0.008], METAL));
    }
    parts
}
