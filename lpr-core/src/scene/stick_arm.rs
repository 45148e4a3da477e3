//! An arm for tests: the Panda's kinematics with balls along straight sticks, so that no test hangs
//! on the real arms' geometry.

use crate::robot::{HAND, Joint, JointConfig, Link, N_LINKS, PANDA, Robot, Sphere};
use glamx::{Pose3, Vec3};

/// Radius of the balls along the links, metres.
const RADIUS: f32 = 0.05;

pub(crate) fn stick_arm() -> Robot {
    let near = (0..N_LINKS)
        .flat_map(|a| (a + 1..N_LINKS).filter(move |b| b - a <= 3).map(move |b| (a, b)));
    let link = |(idx, link): (usize, &Link)| Link {
        spheres: match idx {
            0..=6 => stick(next_origin(&PANDA.joints[idx])),
            HAND => hand(),
            _ => stick(Vec3::ZERO),
        },
        capsules: Vec::new(),
        ..link.clone()
    };
    Robot {
        name: "stick".to_owned(),
        links: PANDA.links.iter().enumerate().map(link).collect(),
        allowed_self_collisions: near.collect(),
        close_pairs: Vec::new(),
        ..Robot::clone(&PANDA)
    }
}

/// Its start, turned about the vertical and lifted at the shoulder, radians.
pub(crate) fn at(turn: f32, lift: f32) -> JointConfig {
    let start = PANDA.start;
    JointConfig::from_fn(7, |j| start[j] + [turn, -lift, 0.0, 0.0, 0.0, 0.0, 0.0][j])
}

/// Origin of the joint's frame in the link before it.
fn next_origin(joint: &Joint) -> Vec3 {
    Pose3::from(joint.transform(0.0)).translation
}

/// Balls from the origin of a link to `end`.
fn stick(end: Vec3) -> Vec<Sphere> {
    let n = (end.length() / RADIUS).ceil().max(1.0);
    let ball = |i: u8| Sphere { center: end * (f32::from(i) / n), radius: RADIUS };
    (0..=n as u8).map(ball).collect()
}

/// A bar across the flange's z and two fingers that reach the grip.
fn hand() -> Vec<Sphere> {
    let grip = Pose3::from(PANDA.flange_from_grip);
    let bar = [-0.06, -0.03, 0.0, 0.03, 0.06]
        .map(|y| Sphere { center: grip * Vec3::new(0.0, y, -0.06), radius: 0.03 });
    let fingers = [-0.05, 0.05].into_iter().flat_map(|y| [-0.03, -0.015, 0.0].map(|z| (y, z)));
    let fingers =
        fingers.map(|(y, z)| Sphere { center: grip * Vec3::new(0.0, y, z), radius: 0.01 });
    bar.into_iter().chain(fingers).collect()
}

/// True if no sphere of the arm comes within `margin` (metres, may be negative) of the obstacles
/// or of another link: slow, over every pair, with the kinematics in f64.
pub(crate) fn is_free_by_brute_force(
    robot: &Robot,
    scene: &super::Scene,
    config: &JointConfig,
    margin: f32,
) -> bool {
    let frames = robot.link_frames(config);
    let of_link = |link: usize| {
        robot.links[link].spheres.iter().map(move |s| (frames[link] * s.center, s.radius + margin))
    };
    let meets_scene = (1..N_LINKS).any(|link| {
        let points = if link == HAND { &scene.hand_points } else { &scene.arm_points };
        of_link(link).any(|(center, radius)| {
            points
                .points()
                .iter()
                .any(|point| point.distance(center) < radius + points.point_radius())
                || scene.primitives().any(|primitive| primitive.distance(center) < radius)
        })
    });
    let allowed = |a, b| robot.allowed_self_collisions.contains(&(a, b));
    let meets_itself = (0..N_LINKS).any(|a| {
        (a + 1..N_LINKS).filter(|&b| !allowed(a, b)).any(|b| {
            of_link(a).any(|(center_a, radius_a)| {
                of_link(b)
                    .any(|(center_b, radius_b)| center_a.distance(center_b) < radius_a + radius_b)
            })
        })
    });
    !meets_scene && !meets_itself
}
