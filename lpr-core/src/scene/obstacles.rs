//! The obstacle cloud: what the cameras saw, minus the robot itself, minus what it holds, with the contact rule.
//!
//! No simulator state enters, so the same function serves a real camera. Depth on the table is an obstacle like any other.

use super::primitive::length;
use super::{ArmSpheres, PointCloud, Scene, downsample};
use crate::robot::{HAND, JointConfig, Robot, Sphere};
use glamx::{Pose3, Vec3};

/// One point of the camera's cloud is kept per cube of this side, metres: finer detail than the spheres resolve.
pub const VOXEL: f32 = 0.01;

/// Radius of the ball around every kept point, metres: half a voxel's diagonal and the spacing of a 128 × 128 image at 1 m.
pub const POINT_RADIUS: f32 = 0.01;

/// Points this close to the robot's spheres at the measured configuration are the robot itself, metres.
///
/// It covers the error of depth and calibration, fingers that are not as far open as modelled, and [`POINT_RADIUS`].
pub const SELF_FILTER_INFLATION: f32 = 0.025;

/// Contact rule: points this close to the gripper at the start or the goal are no obstacles for the gripper, metres.
pub const CONTACT_DISTANCE: f32 = 0.02;

/// Corners, in the grip frame, of the box whose points are taken for the held object, metres.
///
/// It reaches 2 cm beyond the grip along the approach, so that a table under a small object stays an obstacle elsewhere.
pub const HELD_BOX: [Vec3; 2] = [Vec3::new(-0.08, -0.08, -0.08), Vec3::new(0.08, 0.08, 0.02)];

/// Distance from the flange to the furthest point of the hand, with fingers and some room, metres.
const HAND_LENGTH: f32 = 0.25;

/// Whether the gripper holds something.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Holding {
    /// The gripper is empty.
    Nothing,
    /// The gripper closed on something.
    Object,
}

/// What the arm knows of itself when it looks at a cloud.
#[derive(Debug, Clone, Copy)]
pub struct ObstacleQuery<'a> {
    /// The arm.
    pub robot: &'a Robot,
    /// Its measured configuration when the cloud was taken.
    pub measured: &'a JointConfig,
    /// `world_from_grip` where it goes next, for the contact rule.
    pub goal: Option<&'a Pose3>,
    /// Whether it holds something.
    pub holding: Holding,
}

/// The scene that a cloud of `points` (world frame, metres) makes.
///
/// Dropped: points that are not finite or beyond the arm's reach, the robot itself, and the held object. Points within
/// [`CONTACT_DISTANCE`] of the gripper at the start or the goal stay obstacles for links 1–7 only.
#[must_use]
pub fn obstacle_scene(query: &ObstacleQuery<'_>, points: &[Vec3]) -> Scene {
    let arm = ArmSpheres::new(query.robot);
    let reach = reach(query.robot);
    let itself = Balls::new(arm.spheres_at(query.measured).map(|(_, sphere)| sphere), SELF_FILTER_INFLATION);
    let world_from_grip = query.robot.grip(query.measured);
    let arm_points: Vec<Vec3> = downsample(points, VOXEL)
        .into_iter()
        .filter(|point| length(*point - reach.center) <= reach.radius)
        .filter(|point| !itself.hold(*point))
        .filter(|point| query.holding == Holding::Nothing || !is_held(&world_from_grip, *point))
        .collect();
    let contact = gripper_in_contact(query, &arm);
    let hand_points: Vec<Vec3> = arm_points.iter().copied().filter(|point| !contact.hold(*point)).collect();
    Scene {
        primitives: Vec::new(),
        arm_points: PointCloud::new(&arm_points, POINT_RADIUS),
        hand_points: PointCloud::new(&hand_points, POINT_RADIUS),
    }
}

/// A ball around the shoulder that the arm with its hand cannot leave.
fn reach(robot: &Robot) -> Sphere {
    let beyond_shoulder: f64 = robot.joints[2..].iter().map(|joint| libm::sqrt(joint.a * joint.a + joint.d * joint.d)).sum();
    let flange = robot.link7_from_flange.translation.length();
    let radius = (beyond_shoulder + flange) as f32 + HAND_LENGTH;
    Sphere { center: Vec3::new(0.0, 0.0, robot.joints[0].d as f32), radius }
}

fn is_held(world_from_grip: &Pose3, point: Vec3) -> bool {
    let in_grip = world_from_grip.inverse_transform_point(point);
    in_grip.cmpge(HELD_BOX[0]).all() && in_grip.cmple(HELD_BOX[1]).all()
}

/// The gripper at the measured configuration and at the goal, inflated by [`CONTACT_DISTANCE`].
fn gripper_in_contact(query: &ObstacleQuery<'_>, arm: &ArmSpheres) -> Balls {
    let start = arm.spheres_at(query.measured).filter(|(link, _)| *link == HAND).map(|(_, sphere)| sphere);
    let grip_from_flange = Pose3::from(query.robot.flange_from_grip.inverse());
    let goal = query.goal.into_iter().flat_map(|world_from_grip| {
        let world_from_flange = *world_from_grip * grip_from_flange;
        let hand = query.robot.spheres[HAND].iter();
        hand.map(move |sphere| Sphere { center: world_from_flange * sphere.center, radius: sphere.radius })
    });
    Balls::new(start.chain(goal), CONTACT_DISTANCE)
}

/// Balls and the box around them.
struct Balls {
    balls: Vec<Sphere>,
    low: Vec3,
    high: Vec3,
}

impl Balls {
    /// The `spheres`, each grown by `inflation` (metres).
    fn new(spheres: impl Iterator<Item = Sphere>, inflation: f32) -> Self {
        let balls: Vec<Sphere> = spheres.map(|ball| Sphere { radius: ball.radius + inflation, ..ball }).collect();
        let low = balls.iter().fold(Vec3::splat(f32::INFINITY), |low, ball| low.min(ball.center - ball.radius));
        let high = balls.iter().fold(Vec3::splat(f32::NEG_INFINITY), |high, ball| high.max(ball.center + ball.radius));
        Self { balls, low, high }
    }

    fn hold(&self, point: Vec3) -> bool {
        point.cmpge(self.low).all()
            && point.cmple(self.high).all()
            && self.balls.iter().any(|ball| (point - ball.center).length_squared() <= ball.radius * ball.radius)
    }
}
