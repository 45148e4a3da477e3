//! How the cells of a grid form the tiles of Winograd's algorithm: 2³ outputs from 4³ inputs.

use core::ops::Range;

/// In place of a row: beyond the grid.
pub(super) const NOWHERE: u32 = u32::MAX;

/// What lies beyond the faces of a grid.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Padding {
    /// Nothing.
    Zero,
    /// The nearest cell of the grid.
    Replicate,
}

/// The tiles of one grid.
#[derive(Debug, Clone)]
pub(crate) struct Tiles {
    pub(super) n_cells: usize,
    /// Rows of the 4³ cells that each tile reads, x fastest.
    pub(super) inputs: Vec<[u32; 64]>,
    /// Rows of the 2³ cells that each tile computes, x fastest; [`NOWHERE`] beyond an odd side.
    pub(super) outputs: Vec<[u32; 8]>,
    /// The smallest groups of successive tiles that compute successive rows.
    pub(super) groups: Vec<Group>,
}

/// Successive tiles that compute successive rows.
#[derive(Debug, Clone)]
pub(super) struct Group {
    pub(super) tiles: Range<usize>,
    pub(super) rows: Range<usize>,
}

impl Tiles {
    /// Tiles of a grid of `[depth, height, width]` whose cells stand in raster order, x fastest.
    pub(crate) fn raster(dims: [usize; 3], padding: Padding) -> Self {
        let rows = (0..dims.iter().product()).collect::<Vec<_>>();
        Self::in_order(dims, padding, &rows)
    }

    /// Tiles of a grid whose cell of raster index `i` stands in row `rows[i]`.
    pub(crate) fn in_order(dims: [usize; 3], padding: Padding, rows: &[usize]) -> Self {
        let n_cells = dims.iter().product::<usize>();
        assert_eq!(rows.len(), n_cells, "a row for each cell");
        let row = |cell: [usize; 3]| {
            u32::try_from(rows[(cell[0] * dims[1] + cell[1]) * dims[2] + cell[2]])
                .expect("grids have fewer cells than 2^32")
        };
        let mut tiles = Vec::new();
        for z in (0..dims[0]).step_by(2) {
            for y in (0..dims[1]).step_by(2) {
                for x in (0..dims[2]).step_by(2) {
                    let origin = [z, y, x];
                    let inputs = core::array::from_fn(|i| {
                        let shift = [i / 16, i / 4 % 4, i % 4];
                        near(origin, shift, dims, padding).map_or(NOWHERE, row)
                    });
                    let outputs = core::array::from_fn(|i| {
                        let cell = [z + i / 4, y + i / 2 % 2, x + i % 2];
                        if (0..3).all(|axis| cell[axis] < dims[axis]) { row(cell) } else { NOWHERE }
                    });
                    tiles.push((inputs, outputs));
                }
            }
        }
        // In the order of the rows, so that tiles of block order need no others beside them.
        tiles.sort_by_key(|(_, outputs): &(_, [u32; 8])| outputs[0]);
        let (inputs, outputs): (Vec<_>, Vec<_>) = tiles.into_iter().unzip();
        let groups = groups(&outputs);
        Self { n_cells, inputs, outputs, groups }
    }

    /// Rows of a sample.
    pub(crate) const fn n_cells(&self) -> usize {
        self.n_cells
    }

    /// For each row the rows of its 3³ neighbourhood, x fastest; none beyond the grid.
    pub(crate) fn neighbours(&self) -> Vec<[Option<usize>; 27]> {
        let mut near = vec![[None; 27]; self.n_cells];
        for (inputs, outputs) in self.inputs.iter().zip(&self.outputs) {
            for (i, &row) in outputs.iter().enumerate().filter(|&(_, &row)| row != NOWHERE) {
                near[row as usize] = core::array::from_fn(|tap| {
                    let place = [i / 4 + tap / 9, i / 2 % 2 + tap / 3 % 3, i % 2 + tap % 3];
                    let row = inputs[(place[0] * 4 + place[1]) * 4 + place[2]];
                    (row != NOWHERE).then_some(row as usize)
                });
            }
        }
        near
    }
}

/// The cell `shift - 1` away from `origin`.
fn near(
    origin: [usize; 3],
    shift: [usize; 3],
    dims: [usize; 3],
    padding: Padding,
) -> Option<[usize; 3]> {
    let mut cell = [0; 3];
    for axis in 0..3 {
        let shifted = origin[axis] + shift[axis];
        let is_inside = (1..=dims[axis]).contains(&shifted);
        if !is_inside && padding == Padding::Zero {
            return None;
        }
        cell[axis] = shifted.saturating_sub(1).min(dims[axis] - 1);
    }
    Some(cell)
}

fn groups(outputs: &[[u32; 8]]) -> Vec<Group> {
    let mut groups: Vec<Group> = Vec::new();
    let (mut first_tile, mut first_row, mut n_rows, mut end) = (0, 0, 0, 0);
    for (tile, rows) in outputs.iter().enumerate() {
        for &row in rows.iter().filter(|&&row| row != NOWHERE) {
            n_rows += 1;
            end = end.max(row as usize + 1);
        }
        if end == first_row + n_rows {
            groups.push(Group { tiles: first_tile..tile + 1, rows: first_row..end });
            (first_tile, first_row, n_rows) = (tile + 1, end, 0);
        }
    }
    groups
}
