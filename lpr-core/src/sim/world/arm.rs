//! Arm geometry for physics and pictures: the robot's capsules as parts.

use crate::robot::{Capsule, HAND, N_LINKS, Robot};
use crate::scene::{Part, Shape};
use glamx::{Pose3, Quat, Vec3};

/// Colour of the links, alternating.
const LINK_RGB: [[u8; 3]; 2] = [[225, 226, 230], [196, 198, 204]];
/// Colour of the hand.
const HAND_RGB: [u8; 3] = [70, 72, 80];

/// Drawable and physical parts of one frame of the robot.
pub(in crate::sim) fn link_parts(robot: &Robot, frame: usize) -> Vec<Part> {
    debug_assert!(frame < N_LINKS, "a robot has {N_LINKS} frames, asked for {frame}");
    let rgb = if frame == HAND { HAND_RGB } else { LINK_RGB[frame % 2] };
    robot.links[frame].capsules.iter().map(|capsule| capsule_part(capsule, rgb)).collect()
}

fn capsule_part(capsule: &Capsule, rgb: [u8; 3]) -> Part {
    let axis = capsule.b - capsule.a;
    let length = axis.length();
    let rotation = if length > 1e-6 {
        Quat::from_rotation_arc(Vec3::Z, axis / length)
    } else {
        Quat::IDENTITY
    };
    let shape = Shape::Capsule { radius: capsule.radius, half_length: 0.5 * length };
    Part::new(shape, Pose3::from_parts(0.5 * (capsule.a + capsule.b), rotation), rgb)
}
