//! Speed of the grip on one interval, as a bound.

/// Bernstein coefficients (degree 4) of a bound to the square of the grip's speed by the chord
/// length, as a share of the limit's square: where it is `g`, a path at the squared speed `x` keeps
/// the limit when `g x ≤ 1`.
#[derive(Debug, Clone, Copy)]
pub(super) struct GripBound(pub(super) [f64; 5]);

impl GripBound {
    /// No limit.
    pub(super) const NONE: Self = Self([0.0; 5]);

    /// The largest coefficient, which bounds all of the interval.
    pub(super) fn max(&self) -> f64 {
        self.0.iter().copied().fold(0.0, f64::max)
    }

    /// The bound for any part of the interval.
    pub(super) fn constant(&self) -> Self {
        Self([self.max(); 5])
    }
}
