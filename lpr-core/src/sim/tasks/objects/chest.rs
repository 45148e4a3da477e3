//! A chest of three drawers on free slides, of the tasks that open and close one.

use crate::scene::Part;
use crate::sim::scene::{BodyKind, JointKind, JointSpec};
use crate::sim::tasks::Placement;
use crate::sim::tasks::builder::{SceneBuilder, cuboid, cylinder_x};
use core::f32::consts::FRAC_PI_8;
use glamx::{Vec2, Vec3};

/// Places where a chest may stand.
pub(in crate::sim::tasks) const PLACEMENT: Placement = Placement {
    center: Vec2::new(0.0, -0.32),
    half_range: Vec2::new(0.06, 0.12),
    max_yaw: FRAC_PI_8,
};

/// Frame: width x, depth y, height z; it stands on legs.
const FRAME: [f32; 3] = [0.379, 0.383, 0.377];
const LEG_HEIGHT: f32 = 0.093;
const PANEL: f32 = 0.0075;
/// Drawer box: width, depth, height.
const DRAWER: [f32; 3] = [0.361, 0.367, 0.112];
const DRAWER_WALL: f32 = 0.007;
/// The drawers, bottom to top: the variations of the tasks.
pub(in crate::sim::tasks) const DRAWERS: [&str; 3] = ["bottom", "middle", "top"];
/// Heights of their handles.
pub(in crate::sim::tasks) const HANDLE_Z: [f32; 3] = [0.163, 0.283, 0.403];
/// The handle bar's axis along y.
pub(in crate::sim::tasks) const HANDLE_Y: f32 = 0.206;
const HANDLE_RADIUS: f32 = 0.0075;
const HANDLE_LENGTH: f32 = 0.075;
/// Front face of the drawers along y.
const FRONT_Y: f32 = 0.185;
const WOOD: [u8; 3] = [150, 105, 70];
const DRAWER_RGB: [u8; 3] = [188, 146, 102];
const METAL: [u8; 3] = [60, 60, 66];

/// Adds the chest with `drawer` (an index of [`DRAWERS`]) pulled out by `pulled` metres; returns
/// the index of that drawer's slide.
pub(in crate::sim::tasks) fn chest(scene: &mut SceneBuilder, drawer: usize, pulled: f32) -> usize {
    let frame = scene.body("chest", BodyKind::Fixed, Vec3::ZERO, 0.0, frame_parts());
    let slides = DRAWERS.into_iter().zip(HANDLE_Z).enumerate().map(|(idx, (name, z))| {
        let name = format!("{name}_drawer");
        let start = if idx == drawer { pulled } else { 0.0 };
        let drawer =
            scene.body(&name, BodyKind::Dynamic, Vec3::new(0.0, start, z), 0.34, drawer_parts());
        scene.joint(JointSpec {
            name: format!("{name}_slide"),
            kind: JointKind::Prismatic,
            parent: frame,
            child: drawer,
            anchor: Vec3::new(0.0, HANDLE_Y + start, z),
            axis: Vec3::Y,
            limits: [0.0, 0.30],
            start,
            brake: 0.0,
            spring: 0.0,
            latch: None,
        })
    });
    slides.collect::<Vec<_>>()[drawer]
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
