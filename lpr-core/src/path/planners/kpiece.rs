//! KPIECE, bidirectional: two trees that grow where a projection of what they have covered is still
//! sparse.
//!
//! "Kinodynamic motion planning by interior-exterior cell exploration" (WAFR 2008), in the
//! geometric form with two trees known as BKPIECE. Deterministic for a generator.
//!
//! # Differences from the original
//!
//! - Straight edges in joint space instead of controls, and a tree at each end.
//! - The projection is on the joints next to the base, with one level of cells instead of a
//!   hierarchy.
//! - A cell's coverage is its number of vertices.
//! - Of an edge that hits something, the first half is kept if that is free: the checks do not tell
//!   how far an edge is free.
//! - The straight motion is tried first, and windings are bounded, as in
//!   [`rrt_connect`](super::rrt_connect).

use super::plan::{Bounds, Plan, sample_near, sampling_bounds, search_twice};
use super::tree::Tree;
use crate::path::joint_path::JointPath;
use crate::path::rejection::Rejection;
use crate::rng::Rng;
use crate::robot::JointConfig;
use crate::scene::MotionChecker;
use rand::RngExt as _;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// Joints, from the base, whose angles are projected on: they move the arm most.
const PROJECTED: usize = 3;

/// A cell with all of these neighbours is interior.
const ALL_NEIGHBOURS: u32 = 2 * PROJECTED as u32;

/// Numbers of [`kpiece`].
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct KpieceSettings {
    /// Furthest that a joint turns in one edge, radians.
    pub range: f32,
    /// Side of a cell, radians.
    pub cell: f32,
    /// Share of the edges that grow from exterior cells, 0 to 1.
    pub exterior_share: f32,
    /// Factor of a cell's score when an edge from it is not free, 0 to 1.
    pub failure_score: f32,
    /// Edges tried before the planner gives up.
    pub max_iterations: u32,
}

impl KpieceSettings {
    /// The numbers that the command line and candidate sets use.
    ///
    /// Shares and scores as in the Open Motion Planning Library's BKPIECE1; range and cell by trial
    /// on 210 problems of MotionBenchMaker.
    pub const STANDARD: Self = Self {
        range: 1.0,
        cell: 0.75,
        exterior_share: 0.9,
        failure_score: 0.5,
        max_iterations: 100_000,
    };
}

/// A free path from `start` to any of `goals`.
///
/// The path found is looked at once more, as in [`rrt_connect`](super::rrt_connect).
///
/// ```
/// use lpr_core::glamx::Vec3;
/// use lpr_core::path::{KpieceSettings, Rejection, kpiece};
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
/// let plan = kpiece(&checker, &start, &[goal], &KpieceSettings::STANDARD, &mut stream(0, Stream::Planner, 0))?;
/// assert!(plan.iterations > 0 && checker.path_is_free(plan.path.configs()));
/// # Ok::<(), Rejection>(())
/// ```
///
/// # Errors
///
/// A [`Rejection`]: no goals, ends that collide, or no path within the iterations.
pub fn kpiece(
    checker: &MotionChecker<'_>,
    start: &JointConfig,
    goals: &[JointConfig],
    settings: &KpieceSettings,
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
    settings: &KpieceSettings,
    rng: &mut Rng,
) -> Result<Plan, Rejection> {
    let bounds = sampling_bounds(checker.arm().limits(), start, goals);
    let mut sides = [&[*start], goals].map(|roots| Side::new(checker, roots, settings.cell));
    for iteration in 1..=settings.max_iterations {
        if checker.is_stopped() {
            return Err(Rejection::Stopped);
        }
        let grown = usize::from(iteration % 2 == 0);
        let Some(leaf) = sides[grown].grow(checker, &bounds, settings, iteration, rng) else {
            continue;
        };
        let config = *sides[grown].tree.config(leaf);
        if let Some(met) = sides[1 - grown].meet(&config, checker, settings.cell, rng) {
            let ends = if grown == 0 { [leaf, met] } else { [met, leaf] };
            return Ok(Plan { path: join(&sides, ends), iterations: iteration });
        }
    }
    Err(Rejection::IterationLimit)
}

/// The path from the start's root through a vertex of each tree to a goal.
fn join(sides: &[Side; 2], [from_start, to_goal]: [usize; 2]) -> JointPath {
    let mut configs = sides[0].tree.to_root(from_start);
    configs.reverse();
    configs.extend(sides[1].tree.to_root(to_goal));
    JointPath(configs)
}

/// A tree and the cells that its vertices lie in.
struct Side {
    tree: Tree,
    cells: Vec<Cell>,
    index: BTreeMap<Coordinates, usize>,
}

type Coordinates = [i32; PROJECTED];

struct Cell {
    vertices: Vec<usize>,
    /// Cells next to it that hold vertices.
    n_neighbours: u32,
    /// Iteration at which it got its first vertex, from 1.
    created: u32,
    /// Times it was chosen, from 1.
    n_chosen: u32,
    /// Progress made from it: 1 until edges fail.
    score: f32,
}

impl Cell {
    /// Importance of the cell: the promise of growing from here.
    fn importance(&self) -> f32 {
        let age = libm::logf(1.0 + self.created as f32);
        age * self.score
            / (self.n_chosen as f32 * (1 + self.n_neighbours) as f32 * self.vertices.len() as f32)
    }

    const fn is_interior(&self) -> bool {
        self.n_neighbours == ALL_NEIGHBOURS
    }
}

impl Side {
    fn new(checker: &MotionChecker<'_>, roots: &[JointConfig], cell: f32) -> Self {
        let mut side = Self {
            tree: Tree::new(checker.arm().level, roots),
            cells: Vec::new(),
            index: BTreeMap::new(),
        };
        for (vertex, root) in roots.iter().enumerate() {
            side.enter(coordinates(root, cell), vertex, 1);
        }
        side
    }

    /// An edge from a vertex of the most important cell to somewhere near, or its first half: the
    /// new vertex, if it is free.
    fn grow(
        &mut self,
        checker: &MotionChecker<'_>,
        bounds: &Bounds,
        settings: &KpieceSettings,
        iteration: u32,
        rng: &mut Rng,
    ) -> Option<usize> {
        let cell = self.most_important(rng.random::<f32>() < settings.exterior_share);
        self.cells[cell].n_chosen += 1;
        let parent = recent(&self.cells[cell].vertices, rng);
        let from = *self.tree.config(parent);
        let target = sample_near(bounds, &from, settings.range, rng);
        let ends = [target, from.lerp(&target, 0.5)];
        let Some(end) = ends.into_iter().find(|end| checker.motion_is_free(&from, end)) else {
            self.cells[cell].score *= settings.failure_score;
            return None;
        };
        let vertex = self.tree.push(end, parent);
        self.enter(coordinates(&end, settings.cell), vertex, iteration);
        Some(vertex)
    }

    /// A vertex in the cell of `config` to which the straight motion is free.
    fn meet(
        &self,
        config: &JointConfig,
        checker: &MotionChecker<'_>,
        cell: f32,
        rng: &mut Rng,
    ) -> Option<usize> {
        let vertices = &self.cells[*self.index.get(&coordinates(config, cell))?].vertices;
        let vertex = vertices[rng.random_range(0..vertices.len())];
        checker.motion_is_free(config, self.tree.config(vertex)).then_some(vertex)
    }

    /// The most important cell that is exterior, or interior, as asked for; of all, if there is
    /// none such.
    fn most_important(&self, exterior: bool) -> usize {
        let of_kind =
            (0..self.cells.len()).filter(|&cell| self.cells[cell].is_interior() != exterior);
        let best = |a: &usize, b: &usize| {
            self.cells[*a].importance().total_cmp(&self.cells[*b].importance())
        };
        of_kind.max_by(best).or_else(|| (0..self.cells.len()).max_by(best)).unwrap_or(0)
    }

    fn enter(&mut self, at: Coordinates, vertex: usize, iteration: u32) {
        if let Some(&cell) = self.index.get(&at) {
            self.cells[cell].vertices.push(vertex);
            return;
        }
        let neighbours: Vec<usize> =
            neighbours(at).filter_map(|next| self.index.get(&next).copied()).collect();
        neighbours.iter().for_each(|&cell| self.cells[cell].n_neighbours += 1);
        let n_neighbours = neighbours.len() as u32;
        self.index.insert(at, self.cells.len());
        self.cells.push(Cell {
            vertices: vec![vertex],
            n_neighbours,
            created: iteration,
            n_chosen: 1,
            score: 1.0,
        });
    }
}

/// The cell of a configuration.
fn coordinates(config: &JointConfig, cell: f32) -> Coordinates {
    config.to_array::<PROJECTED>().map(|q| libm::floorf(q / cell) as i32)
}

/// The cells next to one.
fn neighbours(at: Coordinates) -> impl Iterator<Item = Coordinates> {
    (0..PROJECTED).flat_map(move |axis| {
        [-1, 1].map(|step| {
            let mut next = at;
            next[axis] = i32::saturating_add(next[axis], step);
            next
        })
    })
}

/// One of the vertices, the later the likelier: half-normal from the last with a third of them as
/// deviation.
fn recent(vertices: &[usize], rng: &mut Rng) -> usize {
    let from_last = crate::rng::normal(rng).abs() * vertices.len() as f32 / 3.0;
    vertices[vertices.len() - 1 - (from_last as usize).min(vertices.len() - 1)]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rng::{Stream, stream};
    use crate::scene::stick_arm::stick_arm;
    use crate::scene::{ArmSpheres, Scene};

    fn at(q: [f32; PROJECTED]) -> JointConfig {
        JointConfig::new([q[0], q[1], q[2], 0.0, 0.0, 0.0, 0.0])
    }

    fn side(roots: &[JointConfig]) -> Side {
        let (scene, arm) = (Scene::empty(), ArmSpheres::new(&stick_arm()));
        Side::new(&MotionChecker::new(&scene, &arm, 32.0), roots, 1.0)
    }

    #[test]
    fn a_cell_is_interior_once_all_cells_beside_it_hold_vertices() {
        let around = neighbours([0; PROJECTED]).map(|next| at(next.map(|c| c as f32 + 0.5)));
        let roots: Vec<JointConfig> = around.chain([at([0.5; PROJECTED])]).collect();
        let side = side(&roots);
        assert_eq!(side.cells.iter().filter(|cell| cell.is_interior()).count(), 1);
        assert_eq!(side.most_important(false), roots.len() - 1);
        assert_ne!(side.most_important(true), roots.len() - 1);
    }

    #[test]
    fn what_was_chosen_failed_or_is_crowded_is_less_important() {
        let cell =
            || Cell { vertices: vec![0], n_neighbours: 0, created: 3, n_chosen: 1, score: 1.0 };
        let fresh = cell().importance();
        let worse = [
            Cell { vertices: vec![0, 1], ..cell() },
            Cell { n_neighbours: 1, ..cell() },
            Cell { created: 2, ..cell() },
            Cell { n_chosen: 2, ..cell() },
            Cell { score: 0.5, ..cell() },
        ];
        assert!(worse.iter().all(|cell| cell.importance() < fresh));
    }

    #[test]
    fn later_vertices_grow_more_often() {
        let rng = &mut stream(0, Stream::Planner, 0);
        let vertices: Vec<usize> = (0..9).collect();
        let mut counts = [0_u32; 9];
        (0..9000).for_each(|_| counts[recent(&vertices, rng)] += 1);
        assert!(counts[0] > 0 && counts[0] < counts[4] && counts[4] < counts[8], "{counts:?}");
    }
}
