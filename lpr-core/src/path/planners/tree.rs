//! A tree in joint space with the nearest of its vertices found by all lanes at once.

use crate::lanes::Floats;
use crate::robot::{DOF, JointConfig};
use fearless_simd::{Level, Select as _, Simd, SimdBase as _, dispatch};

/// Vertices that are compared together: a multiple of every width.
const CHUNK: usize = 16;

/// A tree, or several with one root each.
#[derive(Debug)]
pub(super) struct Tree {
    level: Level,
    configs: Vec<JointConfig>,
    /// Index of every vertex's parent; roots are their own.
    parents: Vec<u32>,
    /// The configurations, [`CHUNK`] of them joint by joint and then the next ones; what is beyond the last vertex is infinitely far away.
    columns: Vec<[f32; CHUNK]>,
}

impl Tree {
    pub(super) fn new(level: Level, roots: &[JointConfig]) -> Self {
        let mut tree =
            Self { level, configs: Vec::new(), parents: Vec::new(), columns: Vec::new() };
        for (idx, root) in roots.iter().enumerate() {
            tree.push(*root, idx);
        }
        tree
    }

    pub(super) const fn len(&self) -> usize {
        self.configs.len()
    }

    pub(super) fn config(&self, vertex: usize) -> &JointConfig {
        &self.configs[vertex]
    }

    /// A new vertex.
    pub(super) fn push(&mut self, config: JointConfig, parent: usize) -> usize {
        let vertex = self.configs.len();
        if vertex.is_multiple_of(CHUNK) {
            self.columns.resize(self.columns.len() + config.dof(), [f32::INFINITY; CHUNK]);
        }
        let columns = &mut self.columns[vertex / CHUNK * config.dof()..];
        for (column, q) in columns.iter_mut().zip(config.iter()) {
            column[vertex % CHUNK] = *q;
        }
        self.configs.push(config);
        self.parents.push(parent as u32);
        vertex
    }

    /// The vertex nearest `target`, the first of several, and its distance in radians.
    pub(super) fn nearest(&self, target: &JointConfig) -> (usize, f32) {
        // A number of joints that the compiler knows unrolls the loop over them.
        let (squared, vertex) = if target.dof() == DOF {
            let target = target.to_array::<DOF>();
            dispatch!(self.level, simd => nearest(simd, &self.columns, &target))
        } else {
            dispatch!(self.level, simd => nearest(simd, &self.columns, target))
        };
        (vertex, libm::sqrtf(squared))
    }

    /// Configurations from a vertex to its root.
    pub(super) fn to_root(&self, mut vertex: usize) -> Vec<JointConfig> {
        let mut configs = vec![self.configs[vertex]];
        while self.parents[vertex] as usize != vertex {
            vertex = self.parents[vertex] as usize;
            configs.push(self.configs[vertex]);
        }
        configs
    }
}

/// Squared distance and index of the column nearest `target`.
#[inline(always)]
fn nearest<S: Simd>(simd: S, columns: &[[f32; CHUNK]], target: &[f32]) -> (f32, usize) {
    let width = Floats::<S>::LEN;
    let mut least = Floats::<S>::splat(simd, f32::INFINITY);
    let mut which = S::i32s::splat(simd, 0);
    for (chunk, columns) in columns.chunks_exact(target.len()).enumerate() {
        for part in 0..CHUNK / width {
            let mut squares = Floats::<S>::splat(simd, 0.0);
            for (column, q) in columns.iter().zip(target) {
                let offset =
                    Floats::<S>::from_slice(simd, &column[part * width..(part + 1) * width]) - *q;
                squares += offset * offset;
            }
            let is_nearer = squares.simd_lt(least);
            least = is_nearer.select(squares, least);
            which = is_nearer
                .select(S::i32s::splat(simd, (chunk * CHUNK + part * width) as i32), which);
        }
    }
    let mut best = (f32::INFINITY, usize::MAX);
    for (lane, (squared, first)) in least.as_slice().iter().zip(which.as_slice()).enumerate() {
        best = if (*squared, *first as usize + lane) < best {
            (*squared, *first as usize + lane)
        } else {
            best
        };
    }
    best
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn config() -> impl Strategy<Value = JointConfig> {
        prop::array::uniform7(-3.0_f32..3.0).prop_map(JointConfig::new)
    }

    proptest! {
        #[test]
        fn the_nearest_vertex_is_the_first_of_least_distance(configs in prop::collection::vec(config(), 1..70), target in config(), again in 0..70_usize) {
            let mut configs = configs;
            configs.push(configs[again % configs.len()]);
            let tree = Tree::new(Level::new(), &configs);
            let distances: Vec<f32> = configs.iter().map(|config| config.distance(&target)).collect();
            let least = distances.iter().copied().fold(f32::INFINITY, f32::min);
            let (vertex, distance) = tree.nearest(&target);
            prop_assert_eq!(distance, least);
            prop_assert_eq!(Some(vertex), distances.iter().position(|d| *d == least));
        }
    }
}
