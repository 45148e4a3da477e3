//! Open the upper drawer of a filing cabinet: the first of the paper's two tasks on the real arm,
//! with dimensions of our own.

use super::builder::{SceneBuilder, cuboid, cylinder_y, grip_pose};
use super::{Approach, Placement, SceneSource, Task, TaskScene, TaskSet};
use crate::rng::Rng;
use crate::robot::Gripper;
use crate::scene::Part;
use crate::sim::scene::{BodyKind, Condition, JointKind, JointSpec};
use core::f32::consts::FRAC_PI_8;
use glamx::{Vec2, Vec3};

/// The task.
pub(super) fn open_filing_cabinet() -> Task {
    Task {
        name: "open_filing_cabinet".to_owned(),
        set: TaskSet::Extra,
        goal: "open the upper drawer of the filing cabinet".to_owned(),
        variations: Vec::new(),
        keyframes: 3,
        placement: Placement {
            center: Vec2::new(0.17, 0.0),
            half_range: Vec2::new(0.06, 0.15),
            max_yaw: FRAC_PI_8,
        },
        scenes: SceneSource::Drawn(build),
    }
}

/// Depth x, width y, height z; its front is towards -x, at the task frame.
const CABINET: [f32; 3] = [0.30, 0.26, 0.26];
const PANEL: f32 = 0.01;
/// Depth, width, height of a drawer.
const DRAWER: [f32; 3] = [0.27, 0.23, 0.10];
const DRAWER_WALL: f32 = 0.008;
const DRAWER_MASS: f32 = 0.4;
/// Heights of the drawers' middles.
const DRAWER_Z: [f32; 2] = [0.07, 0.19];
/// Friction of the slides, N.
const BRAKE: f32 = 2.0;
/// Longest pull, the pull at which the task is done, and the demonstrated one, metres.
const MOST: f32 = 0.22;
const OPEN: f32 = 0.12;
const DEMONSTRATED: f32 = 0.16;
/// The handle's bar: how far it stands off the front, its radius and length.
const STAND_OFF: f32 = 0.035;
const BAR_RADIUS: f32 = 0.006;
const BAR_LENGTH: f32 = 0.09;
/// Distance from the bar at which the hand begins, metres.
const APPROACH: f32 = 0.08;

const STEEL: [u8; 3] = [118, 126, 138];
const FRONT: [u8; 3] = [158, 166, 176];
const METAL: [u8; 3] = [52, 54, 60];

fn build(_: usize, _: &mut Rng) -> TaskScene {
    let mut scene = SceneBuilder::new();
    let cabinet = scene.body("cabinet", BodyKind::Fixed, Vec3::ZERO, 0.0, cabinet_parts());
    let slides = ["lower_drawer", "upper_drawer"].into_iter().zip(DRAWER_Z).map(|(name, z)| {
        let drawer = scene.body(
            name,
            BodyKind::Dynamic,
            Vec3::new(0.0, 0.0, z),
            DRAWER_MASS,
            drawer_parts(),
        );
        scene.joint(JointSpec {
            name: format!("{name}_slide"),
            kind: JointKind::Prismatic,
            parent: cabinet,
            child: drawer,
            anchor: Vec3::new(-STAND_OFF, 0.0, z),
            axis: Vec3::NEG_X,
            limits: [0.0, MOST],
            start: 0.0,
            brake: BRAKE,
            spring: 0.0,
            latch: None,
        })
    });
    let joint = slides.last().expect("there are two drawers");
    // The hand looks along +x, its fingers above and below the bar.
    let pulled = |by: f32| grip_pose([-STAND_OFF - by, 0.0, DRAWER_Z[1]], [-90.0, 0.0, -90.0]);
    scene.waypoint(pulled(APPROACH), Gripper::Open, Approach::Free);
    scene.waypoint(pulled(0.0), Gripper::Close, Approach::Linear);
    scene.waypoint(pulled(DEMONSTRATED), Gripper::Close, Approach::Linear);
    scene.finish(vec![Condition::JointMoved { joint, min: OPEN }])
}

/// Sides, back, floor and top.
fn cabinet_parts() -> Vec<Part> {
    let [depth, width, height] = CABINET;
    let (middle, side) = (0.5 * depth, 0.5 * (width - PANEL));
    vec![
        cuboid([middle, side, 0.5 * height], [depth, PANEL, height], STEEL),
        cuboid([middle, -side, 0.5 * height], [depth, PANEL, height], STEEL),
        cuboid([depth - 0.5 * PANEL, 0.0, 0.5 * height], [PANEL, width, height], STEEL),
        cuboid([middle, 0.0, 0.5 * PANEL], [depth, width, PANEL], STEEL),
        cuboid([middle, 0.0, height - 0.5 * PANEL], [depth, width, PANEL], STEEL),
    ]
}

/// A drawer around the middle of its front: floor, four walls, the bar and its two posts.
fn drawer_parts() -> Vec<Part> {
    let [depth, width, height] = DRAWER;
    let (middle, wall) = (0.5 * depth, DRAWER_WALL);
    let mut parts = vec![
        cuboid([0.5 * wall, 0.0, 0.0], [wall, width, height], FRONT),
        cuboid([depth - 0.5 * wall, 0.0, 0.0], [wall, width, height], STEEL),
        cuboid([middle, 0.5 * (width - wall), 0.0], [depth, wall, height], STEEL),
        cuboid([middle, 0.5 * (wall - width), 0.0], [depth, wall, height], STEEL),
        cuboid([middle, 0.0, 0.5 * (wall - height)], [depth, width, wall], STEEL),
        cylinder_y([-STAND_OFF, 0.0, 0.0], BAR_RADIUS, BAR_LENGTH, METAL),
    ];
    for side in [-1.0, 1.0] {
        let y = side * 0.5 * (BAR_LENGTH - 0.008);
        parts.push(cuboid([-0.5 * STAND_OFF, y, 0.0], [STAND_OFF, 0.008, 0.008], METAL));
    }
    parts
}
