//! SBL: two trees of free configurations whose edges are looked at only when they lie on a path.
//!
//! "A single-query bi-directional probabilistic roadmap planner with lazy collision checking" (ISRR
//! 2001). Deterministic for a generator.
//!
//! # Differences from the original
//!
//! - The edges of a path are looked at whole, the longest first, instead of all of them in turns at
//!   ever finer steps: the checks of a motion are spread over it already.
//! - A new milestone tries the nearest in its own cell and the cells beside it, and a random one.
//! - The straight motion is tried first, and windings are bounded, as in
//!   [`rrt_connect`](super::rrt_connect).

mod roadmap;

use super::plan::{Bounds, Plan, sample_near, sampling_bounds, search_twice};
use crate::path::joint_path::JointPath;
use crate::path::rejection::Rejection;
use crate::rng::Rng;
use crate::robot::JointConfig;
use crate::scene::MotionChecker;
use rand::RngExt as _;
use roadmap::{Edge, Roadmap, Root};
use serde::{Deserialize, Serialize};

/// Numbers of [`sbl`].
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SblSettings {
    /// Furthest that a joint turns in one edge (`ρ` in the paper), radians.
    pub range: f32,
    /// Smaller and smaller neighbourhoods of a milestone in which a free configuration is looked
    /// for.
    pub neighbourhoods: u32,
    /// Milestones after which the cells are laid over another pair of joints.
    pub milestones_per_grid: u32,
    /// Attempts at a milestone before the planner gives up.
    pub max_iterations: u32,
}

impl SblSettings {
    /// The numbers that the command line and candidate sets use: by trial on 210 problems of
    /// MotionBenchMaker.
    pub const STANDARD: Self =
        Self { range: 1.0, neighbourhoods: 8, milestones_per_grid: 100, max_iterations: 100_000 };
}

/// A free path from `start` to any of `goals`.
///
/// The path found is looked at once more, as in [`rrt_connect`](super::rrt_connect).
///
/// ```
/// use lpr_core::glamx::Vec3;
/// use lpr_core::path::{Rejection, SblSettings, sbl};
/// use lpr_core::rng::{Stream, stream};
/// use lpr_core::robot::XARM7;
/// use lpr_core::scene::{ArmSpheres, MotionChecker, Primitive, Scene};
///
/// // A post where the hand is at the start.
/// let top = XARM7.grip(&XARM7.start).translation;
/// let post = Primitive::Capsule { a: Vec3 { z: 0.0, ..top }, b: top, radius: 0.03 };
/// let (scene, arm) = (Scene::from_primitives(vec![post]), ArmSpheres::new(&XARM7));
/// let checker = MotionChecker::new(&scene, &arm, 32.0);
/// let (mut start, mut goal) = (XARM7.start, XARM7.start);
/// (start[0], goal[0]) = (0.7, -0.7);
/// let plan = sbl(&checker, &start, &[goal], &SblSettings::STANDARD, &mut stream(0, Stream::Planner, 0))?;
/// assert!(plan.iterations > 0 && checker.path_is_free(plan.path.configs()));
/// # Ok::<(), Rejection>(())
/// ```
///
/// # Errors
///
/// A [`Rejection`]: no goals, ends that collide, or no path within the iterations.
pub fn sbl(
    checker: &MotionChecker<'_>,
    start: &JointConfig,
    goals: &[JointConfig],
    settings: &SblSettings,
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
    settings: &SblSettings,
    rng: &mut Rng,
) -> Result<Plan, Rejection> {
    let bounds = sampling_bounds(checker.arm().limits(), start, goals);
    let mut roadmap = Roadmap::new(start, goals, bounds.clone(), joint_pair(start.dof(), rng));
    let mut n_milestones = 0;
    for iteration in 1..=settings.max_iterations {
        if checker.is_stopped() {
            return Err(Rejection::Stopped);
        }
        let root = if rng.random::<bool>() { Root::Start } else { Root::Goal };
        let Some(milestone) = add_milestone(&mut roadmap, root, checker, &bounds, settings, rng)
        else {
            continue;
        };
        n_milestones += 1;
        if u32::is_multiple_of(n_milestones, settings.milestones_per_grid) {
            roadmap.lay_cells(joint_pair(start.dof(), rng));
        }
        if let Some(path) = connect(&mut roadmap, milestone, checker, settings.range, rng) {
            return Ok(Plan { path, iterations: iteration });
        }
    }
    Err(Rejection::IterationLimit)
}

/// Two different joints, where there are two.
fn joint_pair(dof: usize, rng: &mut Rng) -> [usize; 2] {
    if dof < 2 {
        return [0, 0];
    }
    let first = rng.random_range(0..dof);
    [first, (first + rng.random_range(1..dof)) % dof]
}

/// A free configuration near a milestone where the tree is sparse, as its child; the edge is not
/// looked at.
fn add_milestone(
    roadmap: &mut Roadmap,
    root: Root,
    checker: &MotionChecker<'_>,
    bounds: &Bounds,
    settings: &SblSettings,
    rng: &mut Rng,
) -> Option<usize> {
    let parent = roadmap.sparse(root, rng);
    let center = *roadmap.config(parent);
    let config = (1..=settings.neighbourhoods)
        .map(|n| sample_near(bounds, &center, settings.range / n as f32, rng))
        .find(|config| checker.is_free(config))?;
    Some(roadmap.push(config, parent))
}

/// Joins a milestone with milestones of the other tree: the path through the joint, if all of its
/// edges turn out to be free.
fn connect(
    roadmap: &mut Roadmap,
    milestone: usize,
    checker: &MotionChecker<'_>,
    range: f32,
    rng: &mut Rng,
) -> Option<JointPath> {
    let nearest = roadmap.nearest_opposite(milestone);
    let random = roadmap.sparse(roadmap.root(milestone).other(), rng);
    [nearest, Some(random)].into_iter().flatten().find_map(|opposite| {
        // What failed before may have moved the milestone to the other tree.
        let is_apart = roadmap.root(milestone) != roadmap.root(opposite);
        let is_near =
            roadmap.config(milestone).max_joint_distance(roadmap.config(opposite)) <= range;
        if is_apart && is_near { test_path(roadmap, milestone, opposite, checker) } else { None }
    })
}

/// Looks at the edges of the path through the bridge between milestones of the two trees. An edge
/// that is not free leaves the roadmap: what hung on it goes over the bridge to the other tree.
fn test_path(
    roadmap: &mut Roadmap,
    a: usize,
    b: usize,
    checker: &MotionChecker<'_>,
) -> Option<JointPath> {
    let mut edges = roadmap.unknown_edges(a);
    edges.extend(roadmap.unknown_edges(b));
    edges.push((a, b));
    let length =
        |&(child, parent): &(usize, usize)| roadmap.config(child).distance(roadmap.config(parent));
    edges.sort_by(|edge, other| length(other).total_cmp(&length(edge)));
    let mut bridge = Edge::Unknown;
    for (child, parent) in edges {
        let is_bridge = (child, parent) == (a, b);
        match checker.motion_is_free(roadmap.config(child), roadmap.config(parent)) {
            true if is_bridge => bridge = Edge::Free,
            true => roadmap.mark_free(child),
            false if is_bridge => return None,
            false => {
                let (near, far) =
                    if roadmap.root(child) == roadmap.root(a) { (a, b) } else { (b, a) };
                roadmap.transfer(child, near, far, bridge);
                return None;
            }
        }
    }
    Some(roadmap.path_through(a, b))
}
