//! A box whose lid turns about a free hinge, of the tasks that open and close it.

use crate::scene::Part;
use crate::sim::scene::{BodyKind, JointKind, JointSpec};
use crate::sim::tasks::builder::{SceneBuilder, arc_about, cuboid, turn_about};
use glamx::{Pose3, Quat, Vec3};

/// Tray: width x, depth y, height z. Published is a depth of 0.26, which leaves no room for a
/// finger below the lid's edge.
const TRAY: [f32; 3] = [0.36, 0.22, 0.148];
const WALL: f32 = 0.01;
/// Lid: width, depth, thickness.
const LID: [f32; 3] = [0.35, 0.268, 0.01];
const LID_MASS: f32 = 0.94;
/// Gap between lid and tray, metres.
const GAP: f32 = 0.001;
/// Distance of the grip behind the edge of the lid that it holds, metres.
const HOLD: f32 = 0.014;
/// Greatest opening, radians.
pub(in crate::sim::tasks) const MOST: f32 = 150_f32.to_radians();

const CARDBOARD: [u8; 3] = [176, 138, 92];
const LID_RGB: [u8; 3] = [196, 160, 112];

/// The lid's hinge: a point of its axis, which is x, in the task frame.
#[derive(Debug, Clone, Copy)]
pub(in crate::sim::tasks) struct Hinge(pub(in crate::sim::tasks) Vec3);

impl Hinge {
    /// The motion of the lid by `angle` radians.
    fn turn(self, angle: f32) -> Pose3 {
        turn_about(self.0, Vec3::X, angle)
    }

    /// The grip that holds the edge of a lid that is open by `angle` radians; `away` metres before
    /// that, on the way there.
    pub(in crate::sim::tasks) fn hold(self, angle: f32, away: f32) -> Pose3 {
        let edge = self.0 + Vec3::Y * (LID[1] - HOLD + away);
        self.turn(angle)
            * Pose3::from_parts(edge, Quat::from_rotation_x(core::f32::consts::FRAC_PI_2))
    }

    /// The grip that holds the lid's edge when it has come from one opening to the other, and those
    /// on the way.
    pub(in crate::sim::tasks) fn arc(self, from: f32, to: f32) -> (Pose3, Vec<Pose3>) {
        arc_about(self.hold(from, 0.0), |share| self.turn(share * (to - from)))
    }
}

/// Adds the box with its lid open by `start` radians; returns the index of the hinge.
pub(in crate::sim::tasks) fn cardboard_box(
    scene: &mut SceneBuilder,
    hinge: Hinge,
    start: f32,
) -> usize {
    let tray =
        scene.body("box", BodyKind::Fixed, Vec3::new(hinge.0.x, hinge.0.y, 0.0), 0.0, tray_parts());
    let middle = [0.0, 0.5 * LID[1], 0.0];
    let lid = scene.turned_body(
        "lid",
        hinge.turn(start) * Pose3::from_translation(hinge.0),
        LID_MASS,
        vec![cuboid(middle, LID, LID_RGB)],
    );
    scene.joint(JointSpec {
        name: "lid_hinge".to_owned(),
        kind: JointKind::Revolute,
        parent: tray,
        child: lid,
        anchor: hinge.0,
        axis: Vec3::X,
        limits: [0.0, MOST],
        start,
        brake: 0.0,
        spring: 0.0,
        latch: None,
    })
}

/// Floor and four walls, behind which the hinge is.
fn tray_parts() -> Vec<Part> {
    let [width, depth, height] = TRAY;
    let height = height - 0.5 * LID[2] - GAP;
    let (side, front) = (0.5 * (width - WALL), depth - 0.5 * WALL);
    vec![
        cuboid([0.0, 0.5 * depth, 0.5 * WALL], [width, depth, WALL], CARDBOARD),
        cuboid([side, 0.5 * depth, 0.5 * height], [WALL, depth, height], CARDBOARD),
        cuboid([-side, 0.5 * depth, 0.5 * height], [WALL, depth, height], CARDBOARD),
        cuboid([0.0, 0.5 * WALL, 0.5 * height], [width, WALL, height], CARDBOARD),
        cuboid([0.0, front, 0.5 * height], [width, WALL, height], CARDBOARD),
    ]
}
