//! The obstacle cloud: what the cameras saw, minus the robot itself, minus what it holds, with the
//! contact rule.
//!
//! No simulator state enters, so the same function serves a real camera. Depth on the table is an
//! obstacle like any other.

use super::arm_spheres::ArmSpheres;
use super::cloud::{PointCloud, downsample};
use super::contents::Scene;
use super::link_spheres::ArmPart;
use crate::perception::Observation;
use crate::robot::{HAND, Joint, JointConfig, Robot, Sphere};
use glamx::{Pose3, Vec3};

/// One point of the camera's cloud is kept per cube of this side, metres: finer detail than the
/// spheres resolve.
pub const VOXEL: f32 = 0.01;

/// Radius of the ball around every kept point, metres: half a voxel's diagonal and the spacing of a
/// 128 × 128 image at 1 m.
pub const POINT_RADIUS: f32 = 0.01;

/// Points this close to the robot's spheres at the measured configuration are the robot itself,
/// metres.
///
/// It covers the error of depth and calibration, fingers that are not as far open as modelled, and
/// [`POINT_RADIUS`].
pub const SELF_FILTER_INFLATION: f32 = 0.025;

/// Contact rule: points this close to the gripper at the start or the goal are no obstacles for the
/// gripper, metres.
pub const CONTACT_DISTANCE: f32 = 0.02;

/// Corners, in the grip frame, of the box whose points are taken for the held object, metres.
///
/// It reaches 2 cm beyond the grip along the approach, so that a table under a small object stays
/// an obstacle elsewhere.
pub const HELD_BOX: [Vec3; 2] = [Vec3::new(-0.08, -0.08, -0.08), Vec3::new(0.08, 0.08, 0.02)];

/// Distance from the flange to the furthest point of the hand, with fingers and some room, metres.
const HAND_LENGTH: f32 = 0.25;

/// The load of the gripper.
///
/// An object in the gripper is not in its own way:
///
/// ```
/// use lpr_core::glamx::Vec3;
/// use lpr_core::robot::XARM7;
/// use lpr_core::scene::{Held, ObstacleQuery, obstacle_scene};
///
/// let beside = XARM7.grip(&XARM7.start) * Vec3::new(0.07, 0.0, 0.0);
/// let n_obstacles = |holding| {
///     let query = ObstacleQuery { robot: &XARM7, measured: &XARM7.start, goal: None, holding };
///     obstacle_scene(&query, &[beside]).arm_points().points().len()
/// };
/// assert_eq!((n_obstacles(Held::Nothing), n_obstacles(Held::Object)), (1, 0));
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Held {
    /// The gripper is empty.
    Nothing,
    /// The gripper closed on something.
    Object,
}

/// The state of the arm when a cloud is taken.
#[derive(Debug, Clone, Copy)]
pub struct ObstacleQuery<'a> {
    /// The arm.
    pub robot: &'a Robot,
    /// Its measured configuration when the cloud was taken.
    pub measured: &'a JointConfig,
    /// `world_from_grip` where it goes next, for the contact rule.
    pub goal: Option<&'a Pose3>,
    /// Its load.
    pub holding: Held,
}

/// The scene that the cloud of all cameras of an observation makes: [`obstacle_scene`] at the
/// measured configuration.
#[must_use]
pub fn observed_obstacles(
    robot: &Robot,
    observation: &Observation,
    goal: Option<&Pose3>,
    holding: Held,
) -> Scene {
    let measured = &observation.proprio.joints;
    let points: Vec<Vec3> = observation.colored_points().map(|(point, _)| point).collect();
    obstacle_scene(&ObstacleQuery { robot, measured, goal, holding }, &points)
}

/// The scene that a cloud of `points` (world frame, metres) makes.
///
/// Dropped: points that are not finite or beyond the arm's reach, the robot itself, and the held
/// object. Points within [`CONTACT_DISTANCE`] of the gripper at the start or the goal stay
/// obstacles for links 1–7 only.
///
/// ```
/// use lpr_core::glamx::{Pose3, Vec3};
/// use lpr_core::robot::XARM7;
/// use lpr_core::scene::{Held, ObstacleQuery, obstacle_scene};
///
/// // A camera sees a box on the table, the arm's own elbow, a wall out of reach, and a pixel without depth.
/// let on_box = Vec3::new(0.4, 0.3, 0.1);
/// let elbow = XARM7.link_frames(&XARM7.start)[4].translation;
/// let seen = [on_box, elbow, Vec3::new(5.0, 0.0, 1.0), Vec3::INFINITY];
///
/// // Where the hand goes next, a finger will touch the box.
/// let rotation = XARM7.grip(&XARM7.start).rotation;
/// let goal = Pose3::from_parts(on_box - rotation * Vec3::new(0.0, 0.05, 0.0), rotation);
/// let query = ObstacleQuery { robot: &XARM7, measured: &XARM7.start, goal: Some(&goal), holding: Held::Nothing };
/// let scene = obstacle_scene(&query, &seen);
/// assert_eq!(scene.arm_points().points(), [on_box]);
/// assert!(scene.hand_points().points().is_empty(), "it is no obstacle to the hand");
/// ```
#[must_use]
pub fn obstacle_scene(query: &ObstacleQuery<'_>, points: &[Vec3]) -> Scene {
    let arm = ArmSpheres::new(query.robot);
    let reach = reach(query.robot);
    let itself =
        Balls::new(arm.spheres_at(query.measured).map(|(_, sphere)| sphere), SELF_FILTER_INFLATION);
    let world_from_grip = query.robot.grip(query.measured);
    let in_reach: Vec<Vec3> = points
        .iter()
        .copied()
        .filter(|point| (*point - reach.center).length_squared() <= reach.radius * reach.radius)
        .collect();
    let arm_points: Vec<Vec3> = downsample(&in_reach, VOXEL)
        .into_iter()
        .filter(|point| !itself.hold(*point))
        .filter(|point| query.holding == Held::Nothing || !is_held(&world_from_grip, *point))
        .collect();
    let contact = gripper_in_contact(query, &arm);
    let hand_points: Vec<Vec3> =
        arm_points.iter().copied().filter(|point| !contact.hold(*point)).collect();
    Scene {
        arm_points: PointCloud::new(&arm_points, POINT_RADIUS),
        hand_points: PointCloud::new(&hand_points, POINT_RADIUS),
        ..Scene::empty()
    }
}

/// A ball around the shoulder that the arm with its hand cannot leave.
fn reach(robot: &Robot) -> Sphere {
    let rows = || robot.joints.iter().filter_map(Joint::dh);
    let beyond_shoulder: f64 =
        rows().skip(2).map(|row| libm::sqrt(row.a * row.a + row.d * row.d)).sum();
    let flange = robot.body_from_flange.translation.length();
    let radius = (beyond_shoulder + flange) as f32 + HAND_LENGTH;
    Sphere { center: Vec3::new(0.0, 0.0, rows().next().map_or(0.0, |row| row.d) as f32), radius }
}

fn is_held(world_from_grip: &Pose3, point: Vec3) -> bool {
    let in_grip = world_from_grip.inverse_transform_point(point);
    in_grip.cmpge(HELD_BOX[0]).all() && in_grip.cmple(HELD_BOX[1]).all()
}

/// The gripper at the measured configuration and at the goal, inflated by [`CONTACT_DISTANCE`].
fn gripper_in_contact(query: &ObstacleQuery<'_>, arm: &ArmSpheres) -> Balls {
    let start = arm
        .placed_spheres(query.measured)
        .filter(|(link, _)| link.part == ArmPart::Hand)
        .map(|(_, sphere)| sphere);
    let grip_from_flange = Pose3::from(query.robot.flange_from_grip.inverse());
    let goal = query.goal.into_iter().flat_map(|world_from_grip| {
        let world_from_flange = *world_from_grip * grip_from_flange;
        let hand = query.robot.links[HAND].spheres.iter();
        hand.map(move |sphere| Sphere {
            center: world_from_flange * sphere.center,
            radius: sphere.radius,
        })
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
        let balls: Vec<Sphere> =
            spheres.map(|ball| Sphere { radius: ball.radius + inflation, ..ball }).collect();
        let low = balls
            .iter()
            .fold(Vec3::splat(f32::INFINITY), |low, ball| low.min(ball.center - ball.radius));
        let high = balls
            .iter()
            .fold(Vec3::splat(f32::NEG_INFINITY), |high, ball| high.max(ball.center + ball.radius));
        Self { balls, low, high }
    }

    fn hold(&self, point: Vec3) -> bool {
        point.cmpge(self.low).all()
            && point.cmple(self.high).all()
            && self
                .balls
                .iter()
                .any(|ball| (point - ball.center).length_squared() <= ball.radius * ball.radius)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::stick_arm::stick_arm;

    /// A table with a box, seen without noise, and the arm itself.
    fn view(robot: &Robot) -> Vec<Vec3> {
        let grid = |n: u16, at: f32| f32::from(n) * 0.02 + at;
        let table = (0..60)
            .flat_map(|x| (0..60).map(move |y| Vec3::new(grid(x, -0.3), grid(y, -0.6), 0.0)));
        let arm = ArmSpheres::new(robot);
        let skin = arm.spheres_at(&robot.start).flat_map(|(_, sphere)| {
            [Vec3::X, Vec3::Y, Vec3::Z, -Vec3::X, -Vec3::Y]
                .map(|side| sphere.center + sphere.radius * side)
        });
        table.chain(skin.collect::<Vec<_>>()).chain([Vec3::NAN, Vec3::new(9.0, 0.0, 0.5)]).collect()
    }

    fn query<'a>(robot: &'a Robot, goal: Option<&'a Pose3>, holding: Held) -> ObstacleQuery<'a> {
        ObstacleQuery { robot, measured: &robot.start, goal, holding }
    }

    #[test]
    fn the_arm_is_free_in_a_cloud_of_itself_and_the_table_stays() {
        let robot = stick_arm();
        let scene = obstacle_scene(&query(&robot, None, Held::Nothing), &view(&robot));
        assert!(scene.is_free(&ArmSpheres::new(&robot), &robot.start));
        for point in scene.arm_points.points() {
            assert!(point.is_finite() && point.z == 0.0, "only the table is left, found {point}");
        }
        assert!(scene.arm_points.touches(Vec3::new(0.5, 0.3, 0.05), 0.06));
        assert!(scene.hand_points.touches(Vec3::new(0.5, 0.3, 0.05), 0.06));
    }

    #[test]
    fn the_gripper_may_touch_what_it_reaches_for_and_the_arm_may_not() {
        let robot = stick_arm();
        let mut lowered = robot.grip(&robot.start);
        lowered.translation.z = 0.01;
        let scene = obstacle_scene(&query(&robot, Some(&lowered), Held::Nothing), &view(&robot));
        let finger = lowered * Vec3::new(0.0, 0.05, 0.0);
        assert!(!scene.hand_points.touches(finger, 0.01));
        assert!(scene.arm_points.touches(finger, 0.01));
        assert!(
            scene.hand_points.touches(finger + Vec3::new(0.1, 0.0, 0.0), 0.02),
            "the table elsewhere"
        );
        let goal = robot.ik_nearest(&lowered, &robot.start).unwrap();
        assert!(scene.is_free(&ArmSpheres::new(&robot), &goal));
        let strict = obstacle_scene(&query(&robot, None, Held::Nothing), &view(&robot));
        assert!(!strict.is_free(&ArmSpheres::new(&robot), &goal));
    }

    #[test]
    fn what_the_gripper_holds_is_no_obstacle() {
        let robot = stick_arm();
        // Out of the self-filter, in the box.
        let held = robot.grip(&robot.start) * Vec3::new(0.07, 0.0, 0.0);
        let below = robot.grip(&robot.start) * Vec3::new(0.07, 0.0, 0.05);
        let left = |holding| {
            obstacle_scene(&query(&robot, None, holding), &[held, below])
                .arm_points
                .points()
                .to_vec()
        };
        assert_eq!(left(Held::Object), [below]);
        assert_eq!(left(Held::Nothing).len(), 2);
    }
}
