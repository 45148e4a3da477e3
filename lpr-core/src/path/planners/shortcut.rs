//! Deterministic shortcuts: a free path made shorter, without random numbers.

use crate::path::joint_path::JointPath;
use crate::robot::JointConfig;
use crate::scene::MotionChecker;

/// Times the edges are halved, so that shortcuts can begin and end between vertices.
const HALVINGS: usize = 2;

/// Edges shorter than this are not halved, radians.
const SHORTEST_HALVED: f32 = 0.3;

/// A free path with the same ends as the free path `path`, no longer than it.
///
/// From every vertex on it goes straight to the furthest vertex it can; then the edges are halved
/// and it does so again.
///
/// ```
/// use lpr_core::path::{JointPath, shortcut};
/// use lpr_core::robot::{JointConfig, PANDA};
/// use lpr_core::scene::{ArmSpheres, MotionChecker, Scene};
///
/// let (scene, arm) = (Scene::empty(), ArmSpheres::new(&PANDA));
/// let at = |q: f32| PANDA.start.map(|start| start + q);
/// let detour = JointPath::new(vec![at(0.0), at(-0.1), at(0.1)])?;
/// let short = shortcut(&detour, &MotionChecker::new(&scene, &arm, 32.0));
/// assert_eq!(short.configs(), [at(0.0), at(0.1)], "nothing is in the way");
/// # Ok::<(), lpr_core::Error>(())
/// ```
#[must_use]
pub fn shortcut(path: &JointPath, checker: &MotionChecker<'_>) -> JointPath {
    let mut configs = skip_vertices(path.configs(), checker);
    for _ in 0..HALVINGS {
        if configs.len() == 2 {
            break;
        }
        configs = skip_vertices(&halve_edges(&configs), checker);
    }
    JointPath(configs)
}

/// The path without the vertices that a straight free motion can leave out. Its own edges count as
/// checked.
pub(super) fn skip_vertices(
    configs: &[JointConfig],
    checker: &MotionChecker<'_>,
) -> Vec<JointConfig> {
    let last = configs.len() - 1;
    let mut kept = vec![configs[0]];
    let mut at = 0;
    while at < last {
        let next =
            (at + 2..=last).rev().find(|&to| checker.motion_is_free(&configs[at], &configs[to]));
        at = next.unwrap_or(at + 1);
        kept.push(configs[at]);
    }
    kept
}

fn halve_edges(configs: &[JointConfig]) -> Vec<JointConfig> {
    let mut halved = vec![configs[0]];
    for pair in configs.windows(2) {
        if pair[0].distance(&pair[1]) > SHORTEST_HALVED {
            halved.push(pair[0].lerp(&pair[1], 0.5));
        }
        halved.push(pair[1]);
    }
    halved
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::stick_arm::{at, stick_arm};
    use crate::scene::{ArmSpheres, Primitive, Scene};
    use glamx::Vec3;

    #[test]
    fn a_detour_around_nothing_becomes_straight() {
        let (scene, arm) = (Scene::empty(), ArmSpheres::new(&stick_arm()));
        let checker = MotionChecker::new(&scene, &arm, 32.0);
        let path =
            JointPath(vec![at(0.0, 0.0), at(0.2, 0.6), at(0.8, 0.6), at(0.5, 0.1), at(1.0, 0.0)]);
        assert_eq!(shortcut(&path, &checker), JointPath(vec![at(0.0, 0.0), at(1.0, 0.0)]));
    }

    #[test]
    fn a_detour_around_a_post_gets_shorter_and_stays_free() {
        let robot = stick_arm();
        let arm = ArmSpheres::new(&robot);
        let grip = robot.grip(&robot.start).translation;
        let post = Primitive::Capsule {
            a: Vec3::new(grip.x, 0.0, 0.0),
            b: Vec3::new(grip.x, 0.0, grip.z),
            radius: 0.02,
        };
        let scene = Scene::from_primitives(vec![post]);
        let checker = MotionChecker::new(&scene, &arm, 32.0);
        let path = JointPath(vec![at(-0.8, 0.0), at(-0.8, 0.9), at(0.8, 0.9), at(0.8, 0.0)]);
        assert!(
            checker.path_is_free(path.configs())
                && !checker.motion_is_free(path.start(), path.goal())
        );
        let short = shortcut(&path, &checker);
        assert!(checker.path_is_free(short.configs()));
        assert!(short.length() < 0.8 * path.length(), "{} of {}", short.length(), path.length());
    }
}
