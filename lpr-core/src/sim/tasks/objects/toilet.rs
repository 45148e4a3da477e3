//! A toilet whose seat turns about a free hinge, of the tasks that lift and lower it.

use crate::sim::scene::{BodyKind, JointKind, JointSpec};
use crate::sim::tasks::builder::{SceneBuilder, cuboid, cylinder_z, turn_about};
use glamx::{Pose3, Vec3};

/// Seat slab: width, depth, thickness.
pub(in crate::sim::tasks) const SEAT: [f32; 3] = [0.225, 0.255, 0.011];
/// Height of the bowl's rim.
const BOWL_TOP: f32 = 0.22;
/// Mass of the seat, kg.
const SEAT_MASS: f32 = 0.178;

const PORCELAIN: [u8; 3] = [232, 234, 238];
const WATER: [u8; 3] = [140, 165, 185];
const SEAT_RGB: [u8; 3] = [60, 110, 170];

/// The seat's hinge; its axis is x, and the seat lies flat at 0.
#[derive(Debug, Clone, Copy)]
pub(in crate::sim::tasks) struct Hinge {
    /// A point of the axis, metres.
    pub(in crate::sim::tasks) anchor: Vec3,
    /// Opening at the start, radians.
    pub(in crate::sim::tasks) start: f32,
    /// Greatest opening, radians.
    pub(in crate::sim::tasks) most: f32,
}

impl Hinge {
    /// The motion of the seat by `angle` radians.
    pub(in crate::sim::tasks) fn turn(&self, angle: f32) -> Pose3 {
        turn_about(self.anchor, Vec3::X, angle)
    }
}

/// Adds the toilet; returns the index of the seat's hinge.
pub(in crate::sim::tasks) fn toilet(scene: &mut SceneBuilder, hinge: &Hinge) -> usize {
    let bowl = scene.body(
        "toilet",
        BodyKind::Fixed,
        Vec3::ZERO,
        0.0,
        vec![
            cuboid([0.0, -0.02, 0.05], [0.14, 0.26, 0.10], PORCELAIN),
            cylinder_z([0.0, 0.05, 0.16], 0.11, 0.12, PORCELAIN),
            cuboid([0.0, -0.05, 0.16], [0.20, 0.18, 0.12], PORCELAIN),
            cuboid([0.0, -0.22, 0.20], [0.24, 0.12, 0.40], PORCELAIN),
        ],
    );
    scene.body(
        "water",
        BodyKind::Visual,
        Vec3::new(0.0, 0.05, BOWL_TOP),
        0.0,
        vec![cylinder_z([0.0; 3], 0.085, 0.001, WATER)],
    );
    let center = Vec3::new(0.0, 0.5 * SEAT[1], 0.0);
    let slab = vec![cuboid(center.to_array(), SEAT, SEAT_RGB)];
    let seat = scene.turned_body(
        "seat",
        hinge.turn(hinge.start) * Pose3::from_translation(hinge.anchor),
        SEAT_MASS,
        slab,
    );
    scene.joint(JointSpec {
        name: "seat_hinge".to_owned(),
        kind: JointKind::Revolute,
        parent: bowl,
        child: seat,
        anchor: hinge.anchor,
        axis: Vec3::X,
        limits: [0.0, hinge.most],
        start: hinge.start,
        brake: 0.0,
        spring: 0.0,
        latch: None,
    })
}
