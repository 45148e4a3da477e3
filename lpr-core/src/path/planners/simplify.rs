//! A free path made short and round: vertices left out, corners cut, again and again.
//!
//! Cutting every corner at a share of its edges is a step of Chaikin's subdivision (1974), whose
//! limit is a quadratic B-spline: the path bends where it used to turn. Every new edge is checked.
//! Deterministic, without random numbers.

use super::plan::FINER;
use super::shortcut::skip_vertices;
use crate::path::joint_path::{JointPath, path_length};
use crate::robot::JointConfig;
use crate::scene::MotionChecker;

/// Rounds of cutting and leaving out, at most.
const ROUNDS: usize = 4;

/// A round that shortens the path by less than this share is the last.
const LEAST_GAIN: f32 = 0.01;

/// Shares of the edges at a corner that are cut off, tried in this order.
const CUTS: [f32; 4] = [1.0, 0.75, 0.5, 0.25];

/// A free path with the same ends as the free path `path`, no longer than it, whose corners are cut
/// where there is room.
///
/// The result is looked at once more, at [`FINER`] times the checker's resolution, and closer where
/// something deeper than 1 mm could lie between. Should it turn out to hit something between two
/// checks, `path` is simplified at that resolution; should that touch something still, it stays as
/// it is.
///
/// ```
/// use lpr_core::glamx::Vec3;
/// use lpr_core::path::{JointPath, simplify};
/// use lpr_core::robot::{JointConfig, XARM7};
/// use lpr_core::scene::{ArmSpheres, MotionChecker, Primitive, Scene};
///
/// // Past a post by drawing the arm back.
/// let turned = |q: f32| JointConfig::from_fn(7, |j| if j == 0 { q } else { XARM7.start[j] });
/// let mut back = turned(0.0);
/// back[3] += 0.8;
/// let path = JointPath::new(vec![turned(0.7), back, turned(-0.7)])?;
/// // A post where the hand is at the start.
/// let top = XARM7.grip(&XARM7.start).translation;
/// let post = Primitive::Capsule { a: Vec3 { z: 0.0, ..top }, b: top, radius: 0.03 };
/// let (scene, arm) = (Scene::from_primitives(vec![post]), ArmSpheres::new(&XARM7));
/// let checker = MotionChecker::new(&scene, &arm, 32.0);
/// assert!(checker.path_is_free(path.configs()));
///
/// let simple = simplify(&path, &checker);
/// assert!(simple.length() < path.length() && simple.configs().len() > 3, "shorter, and round");
/// assert!(checker.path_is_free(simple.configs()));
/// # Ok::<(), lpr_core::Error>(())
/// ```
#[must_use]
pub fn simplify(path: &JointPath, checker: &MotionChecker<'_>) -> JointPath {
    let fine = checker.exact(FINER);
    let simple = [checker, &fine]
        .into_iter()
        .map(|checker| simplify_at(path, checker))
        .find(|simple| fine.path_is_free(simple));
    checker.count(&fine);
    simple.map_or_else(|| path.clone(), JointPath)
}

fn simplify_at(path: &JointPath, checker: &MotionChecker<'_>) -> Vec<JointConfig> {
    let mut configs = skip_vertices(path.configs(), checker);
    for _ in 0..ROUNDS {
        if configs.len() == 2 {
            break;
        }
        let before = path_length(&configs);
        configs = skip_vertices(&cut_corners(&configs, checker), checker);
        if before - path_length(&configs) < LEAST_GAIN * before {
            break;
        }
    }
    configs
}

/// Every corner replaced by the longest free cut between the edges that meet there; an edge between
/// two corners is shared.
fn cut_corners(configs: &[JointConfig], checker: &MotionChecker<'_>) -> Vec<JointConfig> {
    let last = configs.len() - 1;
    let mut cut = vec![configs[0]];
    for i in 1..last {
        let corner = configs[i];
        let before = cut[cut.len() - 1];
        // Half of an edge between two corners is left to the corner at its other end.
        let after = if i + 1 < last { corner.lerp(&configs[i + 1], 0.5) } else { configs[last] };
        let ends =
            CUTS.iter().map(|&share| (corner.lerp(&before, share), corner.lerp(&after, share)));
        match ends.into_iter().find(|(from, to)| checker.motion_is_free(from, to)) {
            Some((from, to)) => cut.extend([from, to]),
            None => cut.push(corner),
        }
    }
    // Where a cut begins at the end of the one before, that point stands there twice.
    cut.push(configs[last]);
    cut.dedup();
    cut
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::path::planners::rrt_connect::{RrtSettings, rrt_connect};
    use crate::path::planners::shortcut::shortcut;
    use crate::rng::{Stream, stream};
    use crate::scene::stick_arm::{at, stick_arm};
    use crate::scene::{ArmSpheres, Primitive, Scene};
    use glamx::Vec3;

    #[test]
    fn a_detour_around_nothing_becomes_straight() {
        let (scene, arm) = (Scene::empty(), ArmSpheres::new(&stick_arm()));
        let path =
            JointPath(vec![at(0.0, 0.0), at(0.2, 0.6), at(0.8, 0.6), at(0.5, 0.1), at(1.0, 0.0)]);
        let simple = simplify(&path, &MotionChecker::new(&scene, &arm, 32.0));
        assert_eq!(simple, JointPath(vec![at(0.0, 0.0), at(1.0, 0.0)]));
    }

    #[test]
    fn a_detour_around_a_post_is_free_and_shorter_than_with_shortcuts_alone() {
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
        let settings = RrtSettings { range: 1.0, checks_per_radian: 32.0, max_iterations: 5000 };
        let mut lengths = [0.0, 0.0];
        for seed in 0..10 {
            let rng = &mut stream(seed, Stream::Planner, 0);
            let plan =
                rrt_connect(&checker, &at(-0.8, 0.0), &[at(0.8, 0.0)], &settings, rng).unwrap();
            let simple = simplify(&plan.path, &checker);
            assert_eq!((simple.start(), simple.goal()), (plan.path.start(), plan.path.goal()));
            assert!(checker.finer(FINER).path_is_free(simple.configs()));
            assert!(simple.length() <= plan.path.length());
            lengths[0] += simple.length();
            lengths[1] += shortcut(&plan.path, &checker).length();
        }
        assert!(lengths[0] < 0.97 * lengths[1], "{lengths:?}");
    }
}
