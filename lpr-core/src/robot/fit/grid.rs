//! A surface on a grid: where it is, what it encloses, and how deep inside that is.
//!
//! Cells of side `a` tell inside from outside; cells a quarter as wide, whose centres stand for the
//! surface, tell distances. The samples of a triangle lie so close that a step from a cell to its
//! neighbour cannot cross the surface unseen.

use super::Triangle;
use super::ball::{Ball, Spot};
use core::ops::Range;
use glamx::DVec3;

/// How finely a grid divides the box around a surface.
#[derive(Debug, Clone, Copy)]
pub(super) struct Fineness {
    /// Cells, about.
    pub(super) n_cells: f64,
    /// Most cells along the longest side.
    pub(super) max_per_side: f64,
    /// Side of a cell that is fine enough, metres.
    pub(super) enough: f64,
}

/// Least side of a cell, metres.
const MIN_CELL: f64 = 1e-4;
/// Fine cells along the side of a cell.
const FINE: usize = 4;
/// Spacing of samples on a triangle, in cells.
const SPACING: f64 = 0.125;
/// Most samples of a mesh.
const MAX_SAMPLES: f64 = 5e6;
/// Empty cells around the box, so that the outside is connected.
const PADDING: f64 = 2.0;
/// Distance of a cube's corner from its centre, in sides.
const HALF_DIAGONAL: f64 = 0.866_025_403_784_438_6;
/// Distance of any point of a triangle from the nearest sample, in spacings, at most: rows are half
/// a spacing apart, and the nearest sample of the row is no further.
const SAMPLE_REACH: f64 = core::f64::consts::FRAC_1_SQRT_2;

/// A surface on a grid.
#[derive(Debug)]
pub(super) struct Grid {
    cell: f64,
    /// Distance of any point of the surface from the nearest sample, metres, at most.
    sample_reach: f64,
    /// Every sample with all points that it stands for, and every enclosed cell, the furthest from
    /// the middle first.
    spots: Vec<Spot>,
    middle: DVec3,
    /// Centres of enclosed cells, each with the radius of a ball around it that the surface does
    /// not enter.
    enclosed: Vec<Ball>,
    /// One sample of each cell through which the surface passes.
    on_surface: Vec<Ball>,
}

/// Cells along each axis from the lowest corner.
#[derive(Debug)]
struct Axes {
    low: DVec3,
    cell: f64,
    n: [usize; 3],
}

impl Grid {
    /// The grid of a surface whose points are all within `gap` of a triangle, metres.
    pub(super) fn new(
        triangles: &[Triangle],
        gap: f64,
        fineness: Fineness,
    ) -> Result<Self, String> {
        let axes = Axes::around(triangles, fineness);
        let fine = axes.fine_cells_of(triangles)?;
        let samples: Vec<DVec3> = fine.iter().map(|&(_, idx)| axes.fine_center(idx)).collect();
        let sample_reach = axes.cell * (SAMPLE_REACH * SPACING + HALF_DIAGONAL / FINE as f64) + gap;
        let cells = surface_cells(&axes, &fine, &samples);
        let rows = axes.rows(&cells);
        let mut last = (DVec3::ZERO, f64::INFINITY);
        let ball = |idx: usize| {
            let center = axes.center(idx);
            // No further than the last centre and what is nearest to that.
            let limit = last.1 + last.0.distance(center);
            last = (center, axes.nearest(center, &cells, &rows, limit));
            Ball { center, depth: (last.1 - sample_reach).max(0.0), radius: 0.0 }
        };
        let enclosed: Vec<Ball> =
            axes.enclosed(cells.iter().map(|it| it.idx)).into_iter().map(ball).collect();
        let on_surface = cells
            .iter()
            .map(|it| surface_ball(axes.cell, nearest_to(it.center, it.samples)))
            .collect();
        let (low, high) = bounds(samples.iter());
        let middle = 0.5 * (low + high);
        let spots = spots(&samples, sample_reach, &enclosed, axes.cell, middle);
        Ok(Self { cell: axes.cell, sample_reach, spots, middle, enclosed, on_surface })
    }

    /// The ball around a sample.
    pub(super) fn ball_at(&self, sample: DVec3) -> Ball {
        surface_ball(self.cell, sample)
    }

    /// By how much balls must at least be enlarged so that each enclosed cell and each sample can
    /// be covered by its own.
    pub(super) fn least_tolerance(&self) -> f64 {
        let of_sample = self.sample_reach - self.ball_at(DVec3::ZERO).depth;
        let of_cell = |ball: &Ball| self.cell * HALF_DIAGONAL - ball.depth;
        1.01 * self.enclosed.iter().map(of_cell).fold(of_sample, f64::max)
    }

    /// Everything to cover, the furthest from the middle first.
    pub(super) fn spots(&self) -> &[Spot] {
        &self.spots
    }

    /// The range of spots, the furthest from the middle first, that are about as far from it as a
    /// ball: it covers no others.
    pub(super) fn shell(&self, spots: &[Spot], ball: &Ball) -> Range<usize> {
        // Rounding is far less than a cell.
        let reach = ball.radius + 1e-6 * self.cell;
        let at = ball.center.distance(self.middle);
        let from_middle = |spot: &Spot| spot.center.distance(self.middle);
        let start = spots.partition_point(|spot| from_middle(spot) > at + reach);
        start..spots.partition_point(|spot| from_middle(spot) >= at - reach)
    }

    /// Balls within the solid, and small ones on its surface.
    pub(super) fn balls(&self) -> impl Iterator<Item = Ball> + '_ {
        self.enclosed.iter().chain(&self.on_surface).copied()
    }
}

fn spots(
    samples: &[DVec3],
    sample_reach: f64,
    enclosed: &[Ball],
    cell: f64,
    middle: DVec3,
) -> Vec<Spot> {
    let of_samples = samples.iter().map(|&center| Spot { center, radius: sample_reach });
    let of_cells =
        enclosed.iter().map(|ball| Spot { center: ball.center, radius: cell * HALF_DIAGONAL });
    let mut spots: Vec<Spot> = of_samples.chain(of_cells).collect();
    let from_middle = |spot: &Spot| spot.center.distance_squared(middle);
    spots.sort_by(|a, b| from_middle(b).total_cmp(&from_middle(a)));
    spots
}

/// The corners of the box around points.
fn bounds<'a>(points: impl Iterator<Item = &'a DVec3>) -> (DVec3, DVec3) {
    points.fold((DVec3::MAX, DVec3::MIN), |(low, high), point| (low.min(*point), high.max(*point)))
}

/// The centre of a fine cell may be outside by half its diagonal.
fn surface_ball(cell: f64, sample: DVec3) -> Ball {
    Ball { center: sample, depth: -cell * HALF_DIAGONAL / FINE as f64, radius: 0.0 }
}

/// A cell through which the surface passes.
struct SurfaceCell<'a> {
    idx: usize,
    center: DVec3,
    samples: &'a [DVec3],
}

/// Index of a cell and index of the fine cell in it.
type FineCell = (usize, [usize; 3]);

/// The cells of the surface, from the fine cells, which are sorted by theirs, and their centres.
fn surface_cells<'a>(axes: &Axes, fine: &[FineCell], samples: &'a [DVec3]) -> Vec<SurfaceCell<'a>> {
    let mut rest = samples;
    let cell = |chunk: &[FineCell]| {
        let (samples, others) = rest.split_at(chunk.len());
        rest = others;
        SurfaceCell { idx: chunk[0].0, center: axes.center(chunk[0].0), samples }
    };
    fine.chunk_by(|a, b| a.0 == b.0).map(cell).collect()
}

fn nearest_to(point: DVec3, samples: &[DVec3]) -> DVec3 {
    let nearer = |a: DVec3, b: &DVec3| {
        if b.distance_squared(point) < a.distance_squared(point) { *b } else { a }
    };
    samples.iter().fold(DVec3::MAX, nearer)
}

/// Rows of samples on a triangle, parallel to its longest side: from there, every point sees a row
/// at a right angle.
struct Rows {
    /// The ends of the longest side.
    base: [DVec3; 2],
    apex: DVec3,
    /// Number of intervals between rows, and between samples of the longest row.
    n_rows: f64,
    n_along: f64,
}

impl Rows {
    fn new([a, b, c]: &Triangle, spacing: f64) -> Self {
        let sides = [[*a, *b, *c], [*b, *c, *a], [*c, *a, *b]];
        let length = |[from, to, _]: &Triangle| from.distance_squared(*to);
        let longest = sides
            .iter()
            .fold(sides[0], |most, side| if length(side) > length(&most) { *side } else { most });
        let [from, to, apex] = longest;
        let base_length = libm::sqrt(length(&longest)).max(f64::MIN_POSITIVE);
        let area = (to - from).cross(apex - from);
        let height = libm::sqrt(area.dot(area)) / base_length;
        let n_rows = libm::ceil(2.0 * height / spacing).max(1.0);
        Self { base: [from, to], apex, n_rows, n_along: libm::ceil(base_length / spacing).max(1.0) }
    }

    fn n_samples(&self) -> f64 {
        (self.n_rows + 1.0) * (self.n_along + 1.0)
    }

    fn samples(&self) -> impl Iterator<Item = DVec3> + '_ {
        (0..=self.n_rows as usize).flat_map(move |row| {
            let up = row as f64 / self.n_rows;
            let [from, to] = self.base.map(|end| end + up * (self.apex - end));
            let n_along = libm::ceil((1.0 - up) * self.n_along).max(1.0);
            (0..=n_along as usize).map(move |i| from + i as f64 / n_along * (to - from))
        })
    }
}

impl Axes {
    /// Cells around the corners, an odd number of them along each axis: the middle of a symmetric
    /// solid is that of a cell.
    fn around(triangles: &[Triangle], fineness: Fineness) -> Self {
        let (low, high) = bounds(triangles.as_flattened().iter());
        let sides = high - low;
        let Fineness { n_cells, max_per_side, enough } = fineness;
        let least = (sides.max_element() / max_per_side).max(MIN_CELL);
        let filled = sides.max(DVec3::splat(least));
        let cell = libm::cbrt(filled.x * filled.y * filled.z / n_cells).max(least).max(enough);
        let half_n =
            (0.5 * sides / cell - 0.5).to_array().map(|n| libm::ceil(n).max(0.0) + PADDING);
        let low = 0.5 * (low + high) - cell * (DVec3::from_array(half_n) + 0.5);
        Self { low, cell, n: half_n.map(|n| 2 * n as usize + 1) }
    }

    fn index(&self, [x, y, z]: [usize; 3]) -> usize {
        (z * self.n[1] + y) * self.n[0] + x
    }

    fn center(&self, idx: usize) -> DVec3 {
        let [n_x, n_y, _] = self.n;
        let cell = [idx % n_x, idx / n_x % n_y, idx / n_x / n_y];
        self.low + self.cell * (DVec3::from_array(cell.map(|i| i as f64)) + 0.5)
    }

    fn fine_center(&self, idx: [usize; 3]) -> DVec3 {
        self.low + self.cell / FINE as f64 * (DVec3::from_array(idx.map(|i| i as f64)) + 0.5)
    }

    fn fine_cell(&self, point: DVec3) -> FineCell {
        let idx = ((point - self.low) * (FINE as f64 / self.cell)).to_array();
        let idx: [usize; 3] =
            core::array::from_fn(|axis| (idx[axis] as usize).min(FINE * self.n[axis] - 1));
        (self.index(idx.map(|i| i / FINE)), idx)
    }

    /// The fine cells of all samples, sorted by their cells.
    fn fine_cells_of(&self, triangles: &[Triangle]) -> Result<Vec<FineCell>, String> {
        let spacing = SPACING * self.cell;
        let rows: Vec<Rows> =
            triangles.iter().map(|triangle| Rows::new(triangle, spacing)).collect();
        if rows.iter().map(Rows::n_samples).sum::<f64>() > MAX_SAMPLES {
            return Err(format!(
                "a mesh of {} triangles that are large and many: simplify it",
                triangles.len()
            ));
        }
        let mut fine = Vec::new();
        for sample in rows.iter().flat_map(Rows::samples) {
            let cell = self.fine_cell(sample);
            if fine.last() != Some(&cell) {
                fine.push(cell);
            }
        }
        fine.sort_unstable();
        fine.dedup();
        Ok(fine)
    }

    /// Index of the first of the cells, sorted by index, in each row along x, and their number.
    fn rows(&self, cells: &[SurfaceCell<'_>]) -> Vec<usize> {
        let [n_x, n_y, n_z] = self.n;
        (0..=n_y * n_z).map(|row| cells.partition_point(|it| it.idx < row * n_x)).collect()
    }

    /// Distance of a point from the nearest sample, which is within `limit`, metres: only in cells
    /// that may hold it.
    fn nearest(&self, point: DVec3, cells: &[SurfaceCell<'_>], rows: &[usize], limit: f64) -> f64 {
        let half_diagonal = HALF_DIAGONAL * self.cell;
        let squared = |it: &&SurfaceCell<'_>| it.center.distance_squared(point);
        let in_rows = |reach: f64| {
            let n_cells = reach / self.cell;
            let [_, y, z] = ((point - self.low) / self.cell).to_array();
            let [y, z] = [(y, self.n[1]), (z, self.n[2])].map(|(at, n)| {
                (at - n_cells).max(0.0) as usize..(at + n_cells + 1.0).min(n as f64) as usize
            });
            let n_y = self.n[1];
            z.flat_map(move |z| y.clone().map(move |y| z * n_y + y))
                .flat_map(move |row| &cells[rows[row]..rows[row + 1]])
        };
        // A cell that has samples has one within its own size of its centre.
        let nearest_center =
            in_rows(limit + half_diagonal).map(|it| squared(&it)).fold(f64::INFINITY, f64::min);
        let reach = libm::sqrt(nearest_center) + 2.0 * half_diagonal;
        let near = in_rows(reach).filter(|it| squared(it) <= reach * reach);
        let samples = near.flat_map(|it| it.samples);
        libm::sqrt(samples.map(|it| it.distance_squared(point)).fold(f64::INFINITY, f64::min))
    }

    /// Cells that cannot be reached from outside, face by face, without passing through the
    /// surface.
    fn enclosed(&self, surface: impl Iterator<Item = usize>) -> Vec<usize> {
        let mut is_known = vec![false; self.n.iter().product()];
        surface.for_each(|cell| is_known[cell] = true);
        let mut reached = vec![0];
        is_known[0] = true;
        while let Some(cell) = reached.pop() {
            for next in self.neighbours(cell) {
                if !core::mem::replace(&mut is_known[next], true) {
                    reached.push(next);
                }
            }
        }
        (0..is_known.len()).filter(|&cell| !is_known[cell]).collect()
    }

    fn neighbours(&self, idx: usize) -> impl Iterator<Item = usize> {
        let [n_x, n_y, n_z] = self.n;
        let steps =
            [(1, n_x, idx % n_x), (n_x, n_y, idx / n_x % n_y), (n_x * n_y, n_z, idx / n_x / n_y)];
        steps.into_iter().flat_map(move |(step, n, at)| {
            let (before, after) =
                ((at > 0).then(|| idx - step), (at + 1 < n).then_some(idx + step));
            before.into_iter().chain(after)
        })
    }
}
