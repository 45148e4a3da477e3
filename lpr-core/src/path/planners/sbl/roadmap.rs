//! The two trees of SBL: milestones with edges that may be unknown yet, found by cells.

use crate::path::joint_path::JointPath;
use crate::path::planners::plan::Bounds;
use crate::rng::Rng;
use crate::robot::JointConfig;
use rand::RngExt as _;

/// Cells along each of the two joints that they are laid over: about half a radian wide, for a
/// joint that turns once.
const CELLS: usize = 10;

/// The end of the path that a tree grows from.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Root {
    Start,
    Goal,
}

impl Root {
    pub(super) const fn other(self) -> Self {
        match self {
            Self::Start => Self::Goal,
            Self::Goal => Self::Start,
        }
    }
}

/// Knowledge of the straight motion between two milestones.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Edge {
    Unknown,
    Free,
}

#[derive(Debug)]
struct Milestone {
    config: JointConfig,
    root: Root,
    /// Index of the parent; a root's own.
    parent: usize,
    /// The edge to the parent.
    edge: Edge,
    children: Vec<usize>,
}

/// Milestones of both trees.
#[derive(Debug)]
pub(super) struct Roadmap {
    milestones: Vec<Milestone>,
    bounds: Bounds,
    /// The joints that cells are laid over.
    pair: [usize; 2],
    /// Of the start's tree and of the goals'.
    cells: [Cells; 2],
}

/// The milestones of one tree by cell.
#[derive(Debug)]
struct Cells {
    members: Vec<Vec<usize>>,
    /// Cells that have members.
    occupied: Vec<usize>,
}

impl Roadmap {
    pub(super) fn new(
        start: &JointConfig,
        goals: &[JointConfig],
        bounds: Bounds,
        pair: [usize; 2],
    ) -> Self {
        let cells = [Cells::new(), Cells::new()];
        let mut roadmap = Self { milestones: Vec::new(), bounds, pair, cells };
        roadmap.add(*start, Root::Start, 0, Edge::Free);
        for (goal, idx) in goals.iter().zip(1..) {
            roadmap.add(*goal, Root::Goal, idx, Edge::Free);
        }
        roadmap
    }

    pub(super) fn config(&self, milestone: usize) -> &JointConfig {
        &self.milestones[milestone].config
    }

    /// The tree that a milestone belongs to now.
    pub(super) fn root(&self, milestone: usize) -> Root {
        self.milestones[milestone].root
    }

    /// A new milestone in its parent's tree.
    pub(super) fn push(&mut self, config: JointConfig, parent: usize) -> usize {
        let milestone = self.add(config, self.root(parent), parent, Edge::Unknown);
        self.milestones[parent].children.push(milestone);
        milestone
    }

    fn add(&mut self, config: JointConfig, root: Root, parent: usize, edge: Edge) -> usize {
        let milestone = self.milestones.len();
        self.milestones.push(Milestone { config, root, parent, edge, children: Vec::new() });
        self.cells[root as usize].enter(index(self.cell(&config)), milestone);
        milestone
    }

    /// Lays the cells over another pair of joints.
    pub(super) fn lay_cells(&mut self, pair: [usize; 2]) {
        self.pair = pair;
        self.cells = [Cells::new(), Cells::new()];
        for idx in 0..self.milestones.len() {
            let Milestone { config, root, .. } = self.milestones[idx];
            self.cells[root as usize].enter(index(self.cell(&config)), idx);
        }
    }

    /// The two coordinates of the cell of a configuration.
    fn cell(&self, config: &JointConfig) -> [usize; 2] {
        self.pair.map(|j| {
            let (lower, upper) = self.bounds[j];
            let share = (config[j] - lower) / (upper - lower).max(f32::MIN_POSITIVE);
            ((share * CELLS as f32) as usize).min(CELLS - 1)
        })
    }

    /// A milestone of any cell of a tree, all occupied cells being as likely: where milestones are
    /// few, each is the likelier.
    pub(super) fn sparse(&self, root: Root, rng: &mut Rng) -> usize {
        let Cells { members, occupied } = &self.cells[root as usize];
        let members = &members[occupied[rng.random_range(0..occupied.len())]];
        members[rng.random_range(0..members.len())]
    }

    /// The nearest milestone of the other tree in the same cell or one beside it, by the joint that
    /// differs most.
    pub(super) fn nearest_opposite(&self, milestone: usize) -> Option<usize> {
        let config = self.config(milestone);
        let members = &self.cells[self.root(milestone).other() as usize].members;
        let [x, y] = self.cell(config).map(|c| c.saturating_sub(1)..=(c + 1).min(CELLS - 1));
        let near =
            x.flat_map(|x| y.clone().map(move |y| [x, y])).flat_map(|cell| &members[index(cell)]);
        let distances = near.map(|&other| (config.max_joint_distance(self.config(other)), other));
        distances.min_by(|(a, _), (b, _)| a.total_cmp(b)).map(|(_, other)| other)
    }

    /// A milestone and all before it, up to the root.
    fn to_root(&self, milestone: usize) -> impl Iterator<Item = usize> {
        core::iter::successors(Some(milestone), |&at| {
            Some(self.milestones[at].parent).filter(|&parent| parent != at)
        })
    }

    /// Child and parent of every edge between a milestone and its root of which nothing is known.
    pub(super) fn unknown_edges(&self, milestone: usize) -> Vec<(usize, usize)> {
        let unknown =
            self.to_root(milestone).filter(|&at| self.milestones[at].edge == Edge::Unknown);
        unknown.map(|at| (at, self.milestones[at].parent)).collect()
    }

    pub(super) fn mark_free(&mut self, child: usize) {
        self.milestones[child].edge = Edge::Free;
    }

    /// The path from the start to a goal through milestones of the two trees.
    pub(super) fn path_through(&self, a: usize, b: usize) -> JointPath {
        let (from_start, to_goal) = if self.root(a) == Root::Start { (a, b) } else { (b, a) };
        let mut configs: Vec<JointConfig> =
            self.to_root(from_start).map(|at| *self.config(at)).collect();
        configs.reverse();
        configs.extend(self.to_root(to_goal).map(|at| *self.config(at)));
        JointPath(configs)
    }

    /// Takes `child` off its parent; it and all that hangs on it go to the other tree, over a
    /// `bridge` from `near`, one of them, to `far`.
    pub(super) fn transfer(&mut self, child: usize, near: usize, far: usize, bridge: Edge) {
        let (mut at, mut new_parent, mut new_edge) = (near, far, bridge);
        loop {
            let Milestone { parent, edge, .. } = self.milestones[at];
            self.milestones[parent].children.retain(|&other| other != at);
            self.milestones[new_parent].children.push(at);
            self.milestones[at].parent = new_parent;
            self.milestones[at].edge = new_edge;
            if at == child {
                break;
            }
            (at, new_parent, new_edge) = (parent, at, edge);
        }
        self.change_root(near, self.root(far));
    }

    /// Counts a milestone and all that hangs on it among those of `root`.
    fn change_root(&mut self, milestone: usize, root: Root) {
        let mut left = vec![milestone];
        while let Some(at) = left.pop() {
            let cell = index(self.cell(&self.milestones[at].config));
            self.cells[self.milestones[at].root as usize].leave(cell, at);
            self.cells[root as usize].enter(cell, at);
            self.milestones[at].root = root;
            left.extend(&self.milestones[at].children);
        }
    }
}

impl Cells {
    fn new() -> Self {
        Self { members: vec![Vec::new(); CELLS * CELLS], occupied: Vec::new() }
    }

    fn enter(&mut self, cell: usize, milestone: usize) {
        if self.members[cell].is_empty() {
            self.occupied.push(cell);
        }
        self.members[cell].push(milestone);
    }

    fn leave(&mut self, cell: usize, milestone: usize) {
        self.members[cell].retain(|&other| other != milestone);
        if self.members[cell].is_empty() {
            self.occupied.retain(|&other| other != cell);
        }
    }
}

const fn index([x, y]: [usize; 2]) -> usize {
    y * CELLS + x
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rng::{Stream, stream};
    use crate::robot::DOF;
    use proptest::prelude::*;

    fn at(q: f32) -> JointConfig {
        JointConfig::new([q; DOF])
    }

    fn roadmap() -> Roadmap {
        Roadmap::new(
            &at(-1.0),
            &[at(1.0), at(2.0)],
            [(-3.0, 3.0); DOF].into_iter().collect(),
            [0, 1],
        )
    }

    /// Every milestone hangs on its parent, is in its parent's tree and in exactly its own cell of
    /// that tree.
    fn check(roadmap: &Roadmap) {
        for (idx, milestone) in roadmap.milestones.iter().enumerate() {
            let root = roadmap.to_root(idx).last().unwrap();
            assert_eq!(milestone.root, if root == 0 { Root::Start } else { Root::Goal });
            if milestone.parent != idx {
                let siblings = &roadmap.milestones[milestone.parent].children;
                assert_eq!(siblings.iter().filter(|&&other| other == idx).count(), 1);
            }
            let cell = index(roadmap.cell(&milestone.config));
            let count = |cells: &Cells| {
                cells.members.iter().flatten().filter(|&&other| other == idx).count()
            };
            assert_eq!(count(&roadmap.cells[milestone.root as usize]), 1);
            assert_eq!(count(&roadmap.cells[milestone.root.other() as usize]), 0);
            assert!(roadmap.cells[milestone.root as usize].members[cell].contains(&idx));
        }
        for cells in &roadmap.cells {
            let mut occupied = cells.occupied.clone();
            occupied.sort_unstable();
            let with_members = (0..CELLS * CELLS).filter(|&cell| !cells.members[cell].is_empty());
            assert_eq!(occupied, with_members.collect::<Vec<_>>());
        }
    }

    #[test]
    fn what_hung_on_a_blocked_edge_goes_over_the_bridge() {
        let mut roadmap = roadmap();
        let [a, b, c] = [-0.5, 0.0, 0.5].map(at);
        let a = roadmap.push(a, 0);
        let b = roadmap.push(b, a);
        let c = roadmap.push(c, b);
        let aside = roadmap.push(at(0.1), b);
        roadmap.mark_free(c);
        roadmap.transfer(b, c, 1, Edge::Free);
        check(&roadmap);
        assert_eq!(
            [a, b, c, aside].map(|m| roadmap.root(m)),
            [Root::Start, Root::Goal, Root::Goal, Root::Goal]
        );
        assert_eq!(roadmap.to_root(aside).collect::<Vec<_>>(), [aside, b, c, 1]);
        // The edge between b and c is the same, seen from the other end; that between b and a is
        // gone.
        assert_eq!(roadmap.unknown_edges(aside), [(aside, b)]);
        assert!(roadmap.milestones[a].children.is_empty());
    }

    #[test]
    fn a_path_runs_from_the_start_to_a_goal_whichever_end_is_named_first() {
        let mut roadmap = roadmap();
        let a = roadmap.push(at(-0.5), 0);
        let b = roadmap.push(at(1.5), 2);
        let path = JointPath([-1.0, -0.5, 1.5, 2.0].map(at).to_vec());
        assert_eq!(roadmap.path_through(a, b), path);
        assert_eq!(roadmap.path_through(b, a), path);
    }

    proptest! {
        #[test]
        fn trees_stay_trees_under_any_transfers(seed in 0..1000_u64, n in 1..60_usize) {
            let rng = &mut stream(seed, Stream::Planner, 0);
            let mut roadmap = roadmap();
            for step in 0..n {
                let root = if step % 2 == 0 { Root::Start } else { Root::Goal };
                let (near, far) = (roadmap.sparse(root, rng), roadmap.sparse(root.other(), rng));
                let config = JointConfig::from_fn(DOF, |_| rng.random_range(-3.0..3.0));
                roadmap.push(config, near);
                let unknown = roadmap.unknown_edges(near);
                if let Some((child, _)) = unknown.last() {
                    roadmap.transfer(*child, near, far, Edge::Unknown);
                }
                if step % 7 == 0 {
                    roadmap.lay_cells([step % DOF, (step + 1) % DOF]);
                }
            }
            check(&roadmap);
        }

        #[test]
        fn the_nearest_opposite_is_in_the_other_tree_and_none_beside_is_nearer(seed in 0..1000_u64) {
            let rng = &mut stream(seed, Stream::Planner, 0);
            let mut roadmap = roadmap();
            for _ in 0..60 {
                let config = JointConfig::from_fn(DOF, |_| rng.random_range(-3.0..3.0));
                roadmap.push(config, rng.random_range(0..3));
            }
            let of = roadmap.milestones.len() - 1;
            let beside = |a: [usize; 2], b: [usize; 2]| a[0].abs_diff(b[0]) <= 1 && a[1].abs_diff(b[1]) <= 1;
            let near = (0..of).filter(|&m| {
                roadmap.root(m) != roadmap.root(of) && beside(roadmap.cell(roadmap.config(m)), roadmap.cell(roadmap.config(of)))
            });
            let least = near.map(|m| roadmap.config(m).max_joint_distance(roadmap.config(of))).min_by(f32::total_cmp);
            let found = roadmap.nearest_opposite(of);
            prop_assert_eq!(found.map(|m| roadmap.config(m).max_joint_distance(roadmap.config(of))), least);
            prop_assert!(found.is_none_or(|m| roadmap.root(m) != roadmap.root(of)));
        }
    }
}
