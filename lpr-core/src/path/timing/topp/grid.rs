//! The curve in short intervals, over each of which the path's acceleration is constant.

use super::grip_bound::GripBound;
use super::spline::{Piece, SmoothPath};

/// Intervals of a curve at least.
const INTERVALS: f64 = 128.0;

/// Intervals of one piece, where pieces are few.
const INTERVALS_PER_PIECE: usize = 16;

/// Intervals up to which every piece has [`INTERVALS_PER_PIECE`]; curves through more
/// configurations are fine enough without.
const ENOUGH_INTERVALS: usize = 2048;

/// A stretch of one piece of the curve.
#[derive(Debug, Clone, Copy)]
pub(super) struct Interval {
    /// Index of the piece.
    pub(super) piece: usize,
    /// Chord length from the piece's first knot, rad.
    pub(super) offset: f64,
    /// Chord length, rad.
    pub(super) width: f64,
    /// Bound of the grip's speed on it, when that is limited.
    pub(super) grip: GripBound,
}

impl Interval {
    /// Offset of its end.
    pub(super) fn end(&self) -> f64 {
        self.offset + self.width
    }

    /// Its part before `share` of it.
    pub(super) fn before(&self, share: f64) -> Self {
        Self { width: share * self.width, grip: self.grip.constant(), ..*self }
    }

    /// Its part after `share` of it.
    pub(super) fn after(&self, share: f64) -> Self {
        let skipped = share * self.width;
        Self {
            offset: self.offset + skipped,
            width: self.width - skipped,
            grip: self.grip.constant(),
            ..*self
        }
    }

    /// The same stretch on the reversed curve, whose pieces count from the other end.
    fn reversed<const N: usize>(&self, piece: &Piece<N>, n_pieces: usize) -> Self {
        let offset = (piece.length - self.end()).max(0.0);
        Self { piece: n_pieces - 1 - self.piece, offset, grip: self.grip.constant(), ..*self }
    }
}

/// Intervals of all of `path`; knots lie between intervals.
pub(super) fn grid<const N: usize>(path: &SmoothPath<N>) -> Vec<Interval> {
    let at_least = (ENOUGH_INTERVALS / path.n_pieces()).clamp(1, INTERVALS_PER_PIECE);
    let mut intervals = Vec::new();
    for piece in 0..path.n_pieces() {
        let length = path.piece(piece).length;
        let n = (libm::ceil(INTERVALS * length / path.chord_length()) as usize).max(at_least);
        let width = length / n as f64;
        intervals.extend((0..n).map(|i| Interval {
            piece,
            offset: i as f64 * width,
            width,
            grip: GripBound::NONE,
        }));
    }
    intervals
}

/// The intervals of the reversed curve.
pub(super) fn reversed<const N: usize>(
    path: &SmoothPath<N>,
    intervals: &[Interval],
) -> Vec<Interval> {
    intervals
        .iter()
        .rev()
        .map(|interval| interval.reversed(&path.piece(interval.piece), path.n_pieces()))
        .collect()
}
