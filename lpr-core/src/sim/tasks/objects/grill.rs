//! A grill whose lid turns about a hinge with friction, of the tasks that open and close it.

use crate::sim::scene::{BodyKind, JointKind, JointSpec};
use crate::sim::tasks::Placement;
use crate::sim::tasks::builder::{SceneBuilder, arc_about, cuboid, cylinder_y, turn_about};
use core::f32::consts::FRAC_PI_2;
use glamx::{Pose3, Vec2, Vec3};

/// Places where a grill may stand: its frame is in front of the lid's handle.
pub(in crate::sim::tasks) const PLACEMENT: Placement = Placement {
    center: Vec2::new(-0.08, -0.05),
    half_range: Vec2::new(0.04, 0.08),
    max_yaw: FRAC_PI_2,
};

/// The middle of the lid's bar when it is shut, metres.
pub(in crate::sim::tasks) const BAR: [f32; 3] = [0.081, -0.115, 0.316];
/// A point of the hinge; its axis is y.
const HINGE: Vec3 = Vec3::new(0.319, -0.116, 0.293);
/// Friction of the hinge, N·m: the lid stays where it is left.
const BRAKE: f32 = 1.0;
const LID_MASS: f32 = 0.66;
/// Greatest opening, radians.
const MOST: f32 = 60_f32.to_radians();
/// Body: depth x, width y, height z; its middle along x. Published is a depth of 0.303 with
/// whatever stands out in front: here the front lies 4 cm behind the bar, so that the lower finger
/// finds room also half a voxel off.
const BODY: [f32; 3] = [0.27, 0.556, 0.298];
const BODY_X: f32 = 0.256;
/// Middle of the lid along x.
const LID_X: f32 = 0.238;
/// Lid: depth, width, height.
const LID: [f32; 3] = [0.194, 0.291, 0.093];
/// Gap between lid and body, metres.
const GAP: f32 = 0.001;
const BAR_RADIUS: f32 = 0.005;
const BAR_LENGTH: f32 = 0.10;

const ENAMEL: [u8; 3] = [60, 62, 68];
const LID_RGB: [u8; 3] = [170, 52, 44];
const STEEL: [u8; 3] = [175, 180, 188];

/// The motion of the lid by `angle` radians.
pub(in crate::sim::tasks) fn turn(angle: f32) -> Pose3 {
    turn_about(HINGE, Vec3::Y, angle)
}

/// The end of the arc by `angle` radians from `grasp`, and the poses before it.
pub(in crate::sim::tasks) fn arc(grasp: Pose3, angle: f32) -> (Pose3, Vec<Pose3>) {
    arc_about(grasp, |share| turn(share * angle))
}

/// Adds the grill with its lid open by `start` radians; returns the index of the hinge.
pub(in crate::sim::tasks) fn grill(scene: &mut SceneBuilder, start: f32) -> usize {
    let [depth, width, height] = BODY;
    let burner = cuboid([BODY_X, 0.155, height + 0.016], [0.155, 0.226, 0.032], STEEL);
    let body = scene.body(
        "grill",
        BodyKind::Fixed,
        Vec3::ZERO,
        0.0,
        vec![cuboid([BODY_X, 0.0, 0.5 * height], [depth, width, height], ENAMEL), burner],
    );
    let from_hinge = |point: [f32; 3]| (Vec3::from(point) - HINGE).to_array();
    let lid_middle = [LID_X, HINGE.y, height + GAP + 0.5 * LID[2]];
    let lid_front = LID_X - 0.5 * LID[0];
    let mut parts = vec![
        cuboid(from_hinge(lid_middle), LID, LID_RGB),
        cylinder_y(from_hinge(BAR), BAR_RADIUS, BAR_LENGTH, STEEL),
    ];
    for side in [-1.0, 1.0] {
        let post = [0.5 * (BAR[0] + lid_front), BAR[1] + side * 0.5 * (BAR_LENGTH - 0.008), BAR[2]];
        parts.push(cuboid(from_hinge(post), [lid_front - BAR[0], 0.008, 0.008], STEEL));
    }
    let lid =
        scene.turned_body("lid", turn(start) * Pose3::from_translation(HINGE), LID_MASS, parts);
    scene.joint(JointSpec {
        name: "lid_hinge".to_owned(),
        kind: JointKind::Revolute,
        parent: body,
        child: lid,
        anchor: HINGE,
        axis: Vec3::Y,
        limits: [0.0, MOST],
        start,
        brake: BRAKE,
        spring: 0.0,
        latch: None,
    })
}
