//! `RRTConnect`: two trees in joint space that grow towards each other.
//!
//! Kuffner and LaValle, "RRT-Connect: An efficient approach to single-query path planning" (2000), with the balanced choice of
//! the tree to grow. Deterministic for a generator.
//!
//! # Differences from the original
//!
//! - The straight motion is tried before any sampling.
//! - A joint that turns further than once is sampled within half a turn of the start and the goals: a shortest path winds no
//!   further.

use super::{JointPath, Rejection};
use crate::rng::Rng;
use crate::robot::{DOF, JointConfig, Robot};
use crate::scene::MotionChecker;
use core::f32::consts::PI;
use rand::RngExt as _;
use serde::{Deserialize, Serialize};

/// Numbers of [`rrt_connect`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RrtSettings {
    /// Longest edge, radians of joint-space distance.
    pub range: f32,
    /// Configurations checked for each radian of an edge.
    pub checks_per_radian: f32,
    /// Samples before the planner gives up.
    pub max_iterations: u32,
}

/// A path found, and what it took.
#[derive(Debug, Clone, PartialEq)]
pub struct Plan {
    /// A free path, not yet shortened.
    pub path: JointPath,
    /// Samples drawn; 0 when the straight motion is free.
    pub iterations: u32,
}

/// A free path from `start` to any of `goals`.
///
/// # Errors
///
/// A [`Rejection`]: no goals, ends that collide, or no path within the iterations.
pub fn rrt_connect(
    robot: &Robot,
    checker: &MotionChecker<'_>,
    start: &JointConfig,
    goals: &[JointConfig],
    settings: &RrtSettings,
    rng: &mut Rng,
) -> Result<Plan, Rejection> {
    if goals.is_empty() {
        return Err(Rejection::Unreachable);
    }
    if !checker.is_free(start) {
        return Err(Rejection::StartCollides);
    }
    let goals: Vec<JointConfig> = goals.iter().copied().filter(|goal| checker.is_free(goal)).collect();
    if goals.is_empty() {
        return Err(Rejection::GoalCollides);
    }
    if let Some(goal) = goals.iter().find(|goal| checker.motion_is_free(start, goal)) {
        return Ok(Plan { path: JointPath(vec![*start, *goal]), iterations: 0 });
    }
    let bounds = sampling_bounds(robot, start, &goals);
    let (mut grown, mut other) = (Tree::new(Root::Start, &[*start]), Tree::new(Root::Goal, &goals));
    for iteration in 1..=settings.max_iterations {
        if grown.configs.len() > other.configs.len() {
            core::mem::swap(&mut grown, &mut other);
        }
        let sample = JointConfig(bounds.map(|(lower, upper)| lower + (upper - lower) * rng.random::<f32>()));
        if let Some(leaf) = grown.extend(&sample, checker, settings.range)
            && let Some(meeting) = other.connect(&grown.configs[leaf], checker, settings.range)
        {
            return Ok(Plan { path: join(&grown, leaf, &other, meeting), iterations: iteration });
        }
    }
    Err(Rejection::IterationLimit)
}

/// Range of every joint that is sampled.
fn sampling_bounds(robot: &Robot, start: &JointConfig, goals: &[JointConfig]) -> [(f32, f32); DOF] {
    core::array::from_fn(|j| {
        let (low, high) = goals.iter().fold((start[j], start[j]), |(low, high), goal| (goal[j].min(low), goal[j].max(high)));
        (robot.joints[j].lower.max(low - PI), robot.joints[j].upper.min(high + PI))
    })
}

/// The path from the start to a goal through a leaf of one tree and the vertex of the other where they met.
fn join(grown: &Tree, leaf: usize, other: &Tree, meeting: usize) -> JointPath {
    // The meeting vertex is the leaf itself.
    let mut configs = grown.to_root(leaf);
    configs.reverse();
    configs.extend(other.to_root(meeting).into_iter().skip(1));
    if grown.root == Root::Goal {
        configs.reverse();
    }
    JointPath(configs)
}

/// What a tree grows from.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Root {
    Start,
    Goal,
}

/// A tree, or several with one root each.
struct Tree {
    root: Root,
    configs: Vec<JointConfig>,
    /// Index of every vertex's parent; roots are their own.
    parents: Vec<usize>,
}

impl Tree {
    fn new(root: Root, roots: &[JointConfig]) -> Self {
        Self { root, configs: roots.to_vec(), parents: (0..roots.len()).collect() }
    }

    /// One edge of at most `range` towards `target`, if it is free: the new vertex.
    fn extend(&mut self, target: &JointConfig, checker: &MotionChecker<'_>, range: f32) -> Option<usize> {
        let from = self.nearest(target);
        self.step(from, target, checker, range)
    }

    /// Edges up to `target` itself, as long as they are free: the vertex there.
    fn connect(&mut self, target: &JointConfig, checker: &MotionChecker<'_>, range: f32) -> Option<usize> {
        let mut at = self.nearest(target);
        while self.configs[at] != *target {
            at = self.step(at, target, checker, range)?;
        }
        Some(at)
    }

    fn step(&mut self, from: usize, target: &JointConfig, checker: &MotionChecker<'_>, range: f32) -> Option<usize> {
        let start = self.configs[from];
        let distance = start.distance(target);
        let end = if distance > range { start.lerp(target, range / distance) } else { *target };
        if !checker.motion_is_free(&start, &end) {
            return None;
        }
        self.configs.push(end);
        self.parents.push(from);
        Some(self.configs.len() - 1)
    }

    fn nearest(&self, target: &JointConfig) -> usize {
        let mut best = (0, f32::INFINITY);
        for (idx, config) in self.configs.iter().enumerate() {
            let squares: f32 = config.iter().zip(target.iter()).map(|(a, b)| (a - b) * (a - b)).sum();
            if squares < best.1 {
                best = (idx, squares);
            }
        }
        best.0
    }

    /// Configurations from a vertex to its root.
    fn to_root(&self, mut vertex: usize) -> Vec<JointConfig> {
        let mut configs = vec![self.configs[vertex]];
        while self.parents[vertex] != vertex {
            vertex = self.parents[vertex];
            configs.push(self.configs[vertex]);
        }
        configs
    }
}
