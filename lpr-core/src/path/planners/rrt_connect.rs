//! `RRTConnect`: two trees in joint space that grow towards each other.
//!
//! "RRT-Connect: An efficient approach to single-query path planning" (ICRA 2000), with the
//! balanced choice of the tree to grow. Deterministic for a generator.
//!
//! # Differences from the original
//!
//! - The straight motion is tried before any sampling.
//! - A joint that turns further than once is sampled within half a turn of the start and the goals:
//!   a shortest path winds no further.
//! - With more than seven joints most samples are drawn around vertices that were seldom chosen, as
//!   in "Path planning in expansive configuration spaces" (ICRA 1997). In so many dimensions the
//!   others are far from every vertex, and in a shelf hardly any direction towards them is free.

use super::plan::{Bounds, Plan, sample_near, sample_within, sampling_bounds, search_twice};
use super::tree::Tree;
use crate::check::setting;
use crate::error::Result;
use crate::path::joint_path::JointPath;
use crate::path::rejection::Rejection;
use crate::rng::Rng;
use crate::robot::{DOF, JointConfig};
use crate::scene::MotionChecker;
use rand::RngExt as _;
use serde::{Deserialize, Serialize};

/// Distance up to which a vertex is extended after its first failure, radians; it shrinks with
/// further failures and grows with successes by [`ADAPTATION`]. "Dynamic-domain RRTs" (IROS 2005),
/// "Adaptive tuning of the sampling domain" (ICRA 2005).
const DOMAIN: f32 = 4.0;
/// Least such distance, radians.
const LEAST_DOMAIN: f32 = 1.0;
/// Relative change of such a distance.
const ADAPTATION: f32 = 1e-4;

/// Share of the samples that are drawn around a vertex, of an arm of more than seven joints. These
/// three numbers are the best of about a dozen on the problems of a Fetch (eight joints).
const LOCAL_SHARE: f32 = 0.8;
/// Most that a joint of such a sample is away from that of the vertex, radians or metres.
const LOCAL_DISTANCE: f32 = 0.8;
/// Vertices drawn, of which the least used is taken.
const LOCAL_DRAWS: u32 = 8;

/// Least edge that is asked for, radians: a thousand edges to a radian are slow, a million are
/// none.
const LEAST_RANGE: f32 = 1e-3;

/// Numbers of [`rrt_connect`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RrtSettings {
    /// Longest edge, radians of joint-space distance; at least a thousandth.
    pub range: f32,
    /// Configurations checked for each radian of an edge.
    pub checks_per_radian: f32,
    /// Samples before the planner gives up.
    pub max_iterations: u32,
}

impl RrtSettings {
    /// Checks the ranges of all numbers.
    ///
    /// # Errors
    ///
    /// [`Error::Config`](crate::Error::Config) naming the first setting that is out of its range.
    pub fn check(&self) -> Result<()> {
        let Self { range, checks_per_radian, max_iterations: _ } = *self;
        setting(range > 0.0, "rrt.range", "a number above 0", range)?;
        let holds = checks_per_radian.is_finite() && checks_per_radian > 0.0;
        setting(holds, "rrt.checks_per_radian", "a finite number above 0", checks_per_radian)
    }
}

/// A free path from `start` to any of `goals`.
///
/// The path found is looked at once more, half-way between the checks of the search. Should it turn
/// out to hit something there, the search is repeated at [`FINER`](super::FINER) times the
/// checker's resolution.
///
/// ```
/// use lpr_core::glamx::Vec3;
/// use lpr_core::path::{Rejection, RrtSettings, rrt_connect};
/// use lpr_core::rng::{Stream, stream};
/// use lpr_core::robot::XARM7;
/// use lpr_core::scene::{ArmSpheres, MotionChecker, Primitive, Scene};
///
/// // A post where the hand is at the start.
/// let top = XARM7.grip(&XARM7.start).translation;
/// let post = Primitive::Capsule { a: Vec3 { z: 0.0, ..top }, b: top, radius: 0.03 };
/// let (scene, arm) = (Scene::from_primitives(vec![post]), ArmSpheres::new(&XARM7));
/// let checker = MotionChecker::new(&scene, &arm, 32.0);
/// let settings = RrtSettings { range: 1.0, checks_per_radian: 32.0, max_iterations: 5000 };
/// let (mut start, mut goal) = (XARM7.start, XARM7.start);
/// (start[0], goal[0]) = (0.7, -0.7);
///
/// let plan = rrt_connect(&checker, &start, &[goal], &settings, &mut stream(0, Stream::Planner, 0))?;
/// assert_eq!((plan.path.start(), plan.path.goal()), (&start, &goal));
/// assert!(plan.iterations > 0 && checker.path_is_free(plan.path.configs()));
///
/// let no_goals = rrt_connect(&checker, &start, &[], &settings, &mut stream(0, Stream::Planner, 0));
/// assert_eq!(no_goals, Err(Rejection::Unreachable));
/// # Ok::<(), Rejection>(())
/// ```
///
/// # Errors
///
/// A [`Rejection`]: no goals, ends that collide, or no path within the iterations.
pub fn rrt_connect(
    checker: &MotionChecker<'_>,
    start: &JointConfig,
    goals: &[JointConfig],
    settings: &RrtSettings,
    rng: &mut Rng,
) -> Result<Plan, Rejection> {
    search_twice(checker, start, goals, |checker, goals| {
        search(checker, start, goals, settings, rng)
    })
}

fn search(
    checker: &MotionChecker<'_>,
    start: &JointConfig,
    goals: &[JointConfig],
    settings: &RrtSettings,
    rng: &mut Rng,
) -> Result<Plan, Rejection> {
    let bounds = sampling_bounds(checker.arm().limits(), start, goals);
    let range = settings.range.max(LEAST_RANGE);
    let (mut grown, mut other) =
        (Side::new(Root::Start, checker, &[*start]), Side::new(Root::Goal, checker, goals));
    for iteration in 1..=settings.max_iterations {
        if checker.is_stopped() {
            return Err(Rejection::Stopped);
        }
        // The balanced choice: the smaller tree grows, the larger is connected to it.
        if grown.tree.len() > other.tree.len() {
            core::mem::swap(&mut grown, &mut other);
        }
        let sample = grown.sample(&bounds, rng);
        if let Some(leaf) = grown.extend(&sample, checker, range)
            && let Some(meeting) = other.connect(grown.tree.config(leaf), checker, range)
        {
            return Ok(Plan { path: join(&grown, leaf, &other, meeting), iterations: iteration });
        }
    }
    Err(Rejection::IterationLimit)
}

/// The path from the start to a goal through a leaf of one tree and the vertex of the other where
/// they met.
fn join(grown: &Side, leaf: usize, other: &Side, meeting: usize) -> JointPath {
    // The meeting vertex is the leaf itself.
    let mut configs = grown.tree.to_root(leaf);
    configs.reverse();
    configs.extend(other.tree.to_root(meeting).into_iter().skip(1));
    if grown.root == Root::Goal {
        configs.reverse();
    }
    JointPath(configs)
}

/// The end of the path that a tree grows from.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Root {
    Start,
    Goal,
}

/// One of the two trees with the domains of its vertices.
struct Side {
    root: Root,
    tree: Tree,
    /// Distance up to which a vertex is extended, radians.
    domains: Vec<f32>,
    /// Samples drawn around each vertex.
    uses: Vec<u32>,
}

impl Side {
    fn new(root: Root, checker: &MotionChecker<'_>, roots: &[JointConfig]) -> Self {
        Self {
            root,
            tree: Tree::new(checker.arm().level, roots),
            domains: vec![f32::INFINITY; roots.len()],
            uses: vec![0; roots.len()],
        }
    }

    /// Where to grow to next.
    fn sample(&mut self, bounds: &Bounds, rng: &mut Rng) -> JointConfig {
        if bounds.len() <= DOF || rng.random::<f32>() >= LOCAL_SHARE {
            return sample_within(bounds, rng);
        }
        let drawn = (0..LOCAL_DRAWS).map(|_| rng.random_range(0..self.tree.len()));
        let vertex = drawn.min_by_key(|&vertex| self.uses[vertex]).unwrap_or(0);
        self.uses[vertex] += 1;
        sample_near(bounds, self.tree.config(vertex), LOCAL_DISTANCE, rng)
    }

    /// One edge of at most `range` towards `target`, if that lies in the domain of the nearest
    /// vertex and the edge is free: the new vertex.
    fn extend(
        &mut self,
        target: &JointConfig,
        checker: &MotionChecker<'_>,
        range: f32,
    ) -> Option<usize> {
        let (from, distance) = self.tree.nearest(target);
        // A vertex beside an obstacle is the nearest to many samples that it cannot be extended to.
        if distance > self.domains[from] {
            return None;
        }
        let start = *self.tree.config(from);
        let end = if distance > range { start.lerp(target, range / distance) } else { *target };
        if !checker.motion_is_free(&start, &end) {
            self.domains[from] = if self.domains[from].is_infinite() {
                DOMAIN
            } else {
                (self.domains[from] * (1.0 - ADAPTATION)).max(LEAST_DOMAIN)
            };
            return None;
        }
        self.domains[from] *= 1.0 + ADAPTATION;
        Some(self.push(end, from))
    }

    /// Edges of at most `range` up to `target` itself, as long as they are free: the vertex there.
    fn connect(
        &mut self,
        target: &JointConfig,
        checker: &MotionChecker<'_>,
        range: f32,
    ) -> Option<usize> {
        let (mut at, distance) = self.tree.nearest(target);
        let start = *self.tree.config(at);
        let n_edges = libm::ceilf(distance / range).max(1.0) as u32;
        for edge in 1..=n_edges {
            let end = if edge == n_edges {
                *target
            } else {
                start.lerp(target, edge as f32 / n_edges as f32)
            };
            if !checker.motion_is_free(self.tree.config(at), &end) {
                return None;
            }
            at = self.push(end, at);
        }
        Some(at)
    }

    fn push(&mut self, config: JointConfig, parent: usize) -> usize {
        self.domains.push(f32::INFINITY);
        self.uses.push(0);
        self.tree.push(config, parent)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::path::planners::shortcut::shortcut;
    use crate::path::planners::test_scenes::{is_free_densely, turned, wall_with_window};
    use crate::rng::{Stream, stream};
    use crate::scene::ArmSpheres;
    use crate::scene::stick_arm::stick_arm;

    const SETTINGS: RrtSettings =
        RrtSettings { range: 1.0, checks_per_radian: 32.0, max_iterations: 2000 };

    #[test]
    fn paths_through_a_narrow_window_are_free_within_limits_and_no_longer_after_shortcuts() {
        let robot = stick_arm();
        let (scene, arm) = (wall_with_window(), ArmSpheres::new(&robot));
        let (start, goal) = (turned(-0.7), turned(0.7));
        for seed in 0..5 {
            let checker = MotionChecker::new(&scene, &arm, SETTINGS.checks_per_radian);
            let plan = rrt_connect(
                &checker,
                &start,
                &[goal],
                &SETTINGS,
                &mut stream(seed, Stream::Planner, 0),
            )
            .unwrap();
            assert!(plan.iterations > 0, "the wall stands in the straight way");
            let short = shortcut(&plan.path, &checker);
            for path in [&plan.path, &short] {
                assert_eq!((*path.start(), *path.goal()), (start, goal));
                assert!(path.configs().iter().all(|config| robot.within_limits(config)));
                assert!(is_free_densely(&robot, &scene, path));
            }
            assert!(
                plan.path
                    .configs()
                    .windows(2)
                    .all(|pair| pair[0].distance(&pair[1]) < SETTINGS.range + 1e-4)
            );
            assert!(short.length() <= plan.path.length() + 1e-5);
        }
    }

    #[test]
    fn a_seed_gives_one_path_and_another_seed_another() {
        let robot = stick_arm();
        let (scene, arm) = (wall_with_window(), ArmSpheres::new(&robot));
        let checker = MotionChecker::new(&scene, &arm, SETTINGS.checks_per_radian);
        let plan = |seed| {
            let rng = &mut stream(seed, Stream::Planner, 0);
            rrt_connect(&checker, &turned(-0.7), &[turned(0.7)], &SETTINGS, rng).unwrap()
        };
        assert_eq!(plan(1), plan(1));
        assert_ne!(plan(1), plan(2));
    }

    #[test]
    fn samples_of_long_arms_are_mostly_near_vertices_and_those_of_others_anywhere() {
        let scene = wall_with_window();
        let arm = ArmSpheres::new(&stick_arm());
        let checker = MotionChecker::new(&scene, &arm, SETTINGS.checks_per_radian);
        for (dof, fewest, most) in [(7, 0, 2), (8, 750, 850)] {
            let roots = [-1.0, 1.0].map(|at| JointConfig::from_fn(dof, |_| at));
            let mut side = Side::new(Root::Goal, &checker, &roots);
            let bounds: Bounds = (0..dof).map(|_| (-1.2, 3.0)).collect();
            let rng = &mut stream(0, Stream::Planner, 0);
            let mut n_near = 0;
            for _ in 0..1000 {
                let sample = side.sample(&bounds, rng);
                assert!(sample.iter().all(|q| (-1.2..=3.0).contains(q)));
                let is_near = |root: &JointConfig| root.max_joint_distance(&sample) <= 0.8;
                n_near += u32::from(roots.iter().any(is_near));
            }
            assert!((fewest..=most).contains(&n_near), "{dof} joints: {n_near} of 1000");
            assert!(side.uses[0].abs_diff(side.uses[1]) <= 20, "{:?}", side.uses);
        }
    }

    #[test]
    fn a_straight_way_is_taken_without_samples_and_to_the_first_goal_it_reaches() {
        let robot = stick_arm();
        let (scene, arm) = (wall_with_window(), ArmSpheres::new(&robot));
        let checker = MotionChecker::new(&scene, &arm, SETTINGS.checks_per_radian);
        let rng = &mut stream(0, Stream::Planner, 0);
        let goals = [turned(0.7), turned(-1.2)];
        let plan = rrt_connect(&checker, &turned(-0.7), &goals, &SETTINGS, rng).unwrap();
        assert_eq!(plan, Plan { path: JointPath(vec![turned(-0.7), turned(-1.2)]), iterations: 0 });
    }

    #[test]
    fn failures_have_their_reasons() {
        let robot = stick_arm();
        let arm = ArmSpheres::new(&robot);
        let scene = wall_with_window();
        let checker = MotionChecker::new(&scene, &arm, SETTINGS.checks_per_radian);
        let plan = |start, goals: &[JointConfig], max_iterations| {
            let settings = RrtSettings { max_iterations, ..SETTINGS };
            rrt_connect(&checker, &start, goals, &settings, &mut stream(0, Stream::Planner, 0))
        };
        assert_eq!(plan(turned(0.0), &[turned(0.7)], 10), Err(Rejection::StartCollides));
        assert_eq!(plan(turned(-0.7), &[turned(0.0)], 10), Err(Rejection::GoalCollides));
        assert_eq!(plan(turned(-0.7), &[turned(0.7)], 0), Err(Rejection::IterationLimit));
        assert_eq!(plan(turned(-0.7), &[], 10), Err(Rejection::Unreachable));
    }
}
