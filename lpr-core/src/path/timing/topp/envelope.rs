//! The squares of the path's speed that one interval allows at its two ends.
//!
//! With `x` and `y` the squares of the path's speed at the start and the end of an interval of
//! width `h`, the path's acceleration on it is `u = (y - x) / 2h`, and its squared speed is linear
//! along it. A joint's acceleration `q' u + q'' ẋ²` is then a polynomial of degree 2 in the chord
//! length and the square of its velocity one of degree 5. A polynomial is never above its largest
//! Bernstein coefficient, and these are linear in `x` and `y`: limits become constraints
//! `|a x + b y| ≤ 1`, and what keeps them keeps the limits on all of the interval, not only where
//! it was looked at.
//!
//! Every constraint leaves room around the origin, so that the largest `x` follows from one
//! variable: along the ray `y = r x` it is one over the largest `|a + b r|`, a convex function of
//! `r`.

use super::grid::Interval;
use super::spline::Piece;
use crate::path::timing::motion_limits::MotionLimits;
use crate::robot::{DOF, MAX_JOINTS};

/// Constraints of a joint: three coefficients of its acceleration and six of its squared velocity.
const CONSTRAINTS_PER_JOINT: usize = 9;

/// Groups of constraints of an interval of an arm with up to `n_joints` joints: of the joints, six of
/// the grip's speed, and the two of [`Constraints::of`]. Empty ones fill the last lanes.
const fn n_groups(n_joints: usize) -> usize {
    (n_joints * CONSTRAINTS_PER_JOINT + 8).div_ceil(LANES)
}

/// Groups for an arm of the built-in ones' size, and for any.
pub(super) const FEW: usize = n_groups(DOF);
pub(super) const MANY: usize = n_groups(MAX_JOINTS);

/// Share by which constraints may be exceeded where `x` is the largest there is: rounding would
/// else leave no `y` beside it.
const SLACK: f64 = 1e-9;

/// Constraints that are compared side by side.
const LANES: usize = 4;

/// Squares of path speeds that no limit leaves are cut off here, (rad/s)²: where every derivative
/// of the curve vanishes at once.
const MAX_SQUARE: f64 = 1e12;

/// The squared speed falls by no more than this factor over an interval, so that the path never
/// stands still on its way.
const LEAST_RATIO: f64 = 1e-4;

/// Constraints `|a x + b y| ≤ 1` in `G` groups.
#[derive(Debug, Clone)]
pub(super) struct Constraints<const G: usize> {
    a: [[f64; LANES]; G],
    b: [[f64; LANES]; G],
    n: usize,
}

/// One side of a constraint, `a x + b y ≤ 1`, and the line `a + b r` over the rays.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Constraint {
    a: f64,
    b: f64,
}

/// A ray `y = ratio x` and the largest `x` on it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Ray {
    pub(super) ratio: f64,
    pub(super) max: f64,
}

impl<const G: usize> Constraints<G> {
    /// The constraints of an interval at whose end the squared speed is at most `max_end`; 0 leaves
    /// that to the caller's ray.
    pub(super) fn of<const N: usize>(
        piece: &Piece<N>,
        interval: &Interval,
        limits: &MotionLimits<N>,
        max_end: f64,
    ) -> Self {
        let mut constraints = Self { a: [[0.0; LANES]; G], b: [[0.0; LANES]; G], n: 0 };
        constraints.push(1.0 / MAX_SQUARE, 0.0);
        constraints.push(0.0, if max_end > 0.0 { 1.0 / max_end } else { 0.0 });
        constraints.push_squared_speed(&interval.grip.0);
        constraints.push_joints(piece, interval, limits);
        constraints
    }

    fn push(&mut self, a: f64, b: f64) {
        self.a[self.n / LANES][self.n % LANES] = a;
        self.b[self.n / LANES][self.n % LANES] = b;
        self.n += 1;
    }

    fn push_joints<const N: usize>(
        &mut self,
        piece: &Piece<N>,
        interval: &Interval,
        limits: &MotionLimits<N>,
    ) {
        let (first, first_at_end) = (piece.first(interval.offset), piece.first(interval.end()));
        let (second, second_at_end) = (piece.second(interval.offset), piece.second(interval.end()));
        let half_width = 0.5 * interval.width;
        for j in 0..N {
            let slopes = [first[j], first[j] + half_width * second[j], first_at_end[j]];
            let per_velocity = 1.0 / (limits.velocity[j] * limits.velocity[j]);
            self.push_squared_speed(&square(slopes).map(|square| square * per_velocity));
            self.push_acceleration(
                slopes,
                [second[j], second_at_end[j]],
                interval.width,
                limits.acceleration[j],
            );
        }
    }

    /// Constraints of `slopes u + bends x` within ±`limit`; `slopes` are the coefficients of a
    /// parabola, `bends` those of a line.
    fn push_acceleration(&mut self, slopes: [f64; 3], bends: [f64; 2], width: f64, limit: f64) {
        let per_limit = 1.0 / limit;
        let [start, middle, end] = slopes.map(|slope| slope * (0.5 / width * per_limit));
        let [bend, bend_at_end] = bends.map(|bend| bend * per_limit);
        self.push(bend - start, start);
        self.push(0.5 * bend_at_end - middle, 0.5 * bend + middle);
        self.push(-end, bend_at_end + end);
    }

    /// Constraints of a squared speed per path speed, degree 4, times the squared path speed,
    /// degree 1.
    fn push_squared_speed(&mut self, squares: &[f64; 5]) {
        self.push(squares[0], 0.0);
        for k in 1..5_u8 {
            let share = f64::from(k) / 5.0;
            self.push((1.0 - share) * squares[usize::from(k)], share * squares[usize::from(k) - 1]);
        }
        self.push(0.0, squares[4]);
    }

    /// The ray with the largest `x`; `max_end`, above 0, is that of [`Self::of`].
    pub(super) fn highest_ray(&self, max_end: f64) -> Ray {
        let mut falling = self.top(LEAST_RATIO);
        if falling.b >= 0.0 {
            return falling.ray(LEAST_RATIO);
        }
        let mut rising = Constraint { a: 0.0, b: 1.0 / max_end };
        // Between its ends the squared speed mostly changes little.
        let near = self.top(1.0);
        *(if near.b > 0.0 { &mut rising } else { &mut falling }) = near;
        let mut best = Ray { ratio: 0.0, max: 0.0 };
        // Each round finds a constraint that was not on top before, or is the last.
        for _ in 0..G * LANES {
            let ratio = (falling.a - rising.a) / (rising.b - falling.b);
            let top = self.top(ratio);
            let ray = top.ray(ratio);
            if ray.max > best.max {
                best = ray;
            }
            if top == falling || top == rising {
                break;
            }
            *(if top.b > 0.0 { &mut rising } else { &mut falling }) = top;
        }
        best
    }

    /// The ray of that ratio.
    pub(super) fn ray(&self, ratio: f64) -> Ray {
        self.top(ratio).ray(ratio)
    }

    /// The largest `y` beside `x`; at least that of `ray`, which is allowed.
    pub(super) fn largest_end(&self, x: f64, ray: Ray) -> f64 {
        let mut ends = [f64::INFINITY; LANES];
        for (a, b) in self.a.iter().zip(&self.b) {
            for lane in 0..LANES {
                // The side of the constraint that bounds from above: infinitely far without `y`.
                let towards = if b[lane] < 0.0 { -a[lane] } else { a[lane] };
                let end = (1.0 + SLACK - towards * x) / b[lane].abs();
                ends[lane] = if end < ends[lane] { end } else { ends[lane] };
            }
        }
        ends.into_iter().fold(f64::INFINITY, f64::min).max(ray.ratio * x)
    }

    /// The side of a constraint whose line is highest at `ratio`.
    fn top(&self, ratio: f64) -> Constraint {
        let (mut top_a, mut top_b, mut heights) =
            (self.a[0], self.b[0], [f64::NEG_INFINITY; LANES]);
        for (a, b) in self.a.iter().zip(&self.b) {
            for lane in 0..LANES {
                let height = (a[lane] + b[lane] * ratio).abs();
                let is_higher = height > heights[lane];
                heights[lane] = if is_higher { height } else { heights[lane] };
                top_a[lane] = if is_higher { a[lane] } else { top_a[lane] };
                top_b[lane] = if is_higher { b[lane] } else { top_b[lane] };
            }
        }
        let lane =
            (1..LANES).fold(0, |top, lane| if heights[lane] > heights[top] { lane } else { top });
        let (a, b) = (top_a[lane], top_b[lane]);
        if a + b * ratio < 0.0 { Constraint { a: -a, b: -b } } else { Constraint { a, b } }
    }
}

impl Constraint {
    /// The end of the ray of that ratio where the constraint holds.
    fn ray(self, ratio: f64) -> Ray {
        Ray { ratio, max: 1.0 / (self.a + self.b * ratio) }
    }
}

/// Bernstein coefficients of the square of a parabola.
fn square([a, b, c]: [f64; 3]) -> [f64; 5] {
    [a * a, a * b, (2.0 * b * b + a * c) / 3.0, b * c, c * c]
}

#[cfg(test)]
mod tests {
    use super::super::grid::grid;
    use super::super::spline::SmoothPath;
    use super::*;
    use crate::path::joint_path::JointPath;
    use crate::robot::{DOF, JointConfig};
    use proptest::prelude::*;

    const LIMITS: MotionLimits =
        MotionLimits { velocity: [2.0; DOF], acceleration: [8.0; DOF], jerk: None };

    fn path() -> impl Strategy<Value = SmoothPath> {
        prop::collection::vec(prop::array::uniform7(-2.0_f32..2.0).prop_map(JointConfig::new), 2..8)
            .prop_map(|configs| <SmoothPath>::through(&JointPath::new(configs).unwrap()))
            .prop_filter("moves", |path| path.n_pieces() > 0)
    }

    /// Largest share of a limit that a joint uses on an interval, looked at densely.
    fn greatest_share(piece: &Piece<DOF>, interval: &Interval, x: f64, y: f64) -> f64 {
        let u = (y - x) / (2.0 * interval.width);
        let mut greatest = 0.0_f64;
        for i in 0..=32 {
            let t = f64::from(i) / 32.0;
            let offset = interval.offset + t * interval.width;
            let square = x + t * (y - x);
            for (slope, bend) in piece.first(offset).into_iter().zip(piece.second(offset)) {
                let velocity = slope.abs() * libm::sqrt(square) / LIMITS.velocity[0];
                greatest = greatest
                    .max(velocity)
                    .max((slope * u + bend * square).abs() / LIMITS.acceleration[0]);
            }
        }
        greatest
    }

    proptest! {
        #[test]
        fn what_the_rows_allow_keeps_the_limits_everywhere_and_uses_them(path in path(), idx in 0.0..1.0_f64, cap in 0.01..3.0_f64) {
            let intervals = grid(&path);
            let interval = intervals[(idx * intervals.len() as f64) as usize];
            let piece = path.piece(interval.piece);
            let constraints = Constraints::<FEW>::of(&piece, &interval, &LIMITS, cap);
            let ray = constraints.highest_ray(cap);
            let (x, y) = (ray.max, ray.ratio * ray.max);
            prop_assert!(x > 0.0 && y >= 0.0 && y <= cap * (1.0 + 1e-9));
            prop_assert!(greatest_share(&piece, &interval, x, y) <= 1.0 + 1e-9);
            for share in [0.0, 0.3, 0.9, 1.0] {
                let end = constraints.largest_end(share * x, ray);
                prop_assert!(end <= cap * (1.0 + 2e-9) && end >= share * y * (1.0 - 1e-12));
                let greatest = greatest_share(&piece, &interval, share * x, end);
                prop_assert!(greatest <= 1.0 + 2e-9);
                prop_assert!(greatest >= 0.9 || end >= cap * (1.0 - 1e-9), "{greatest}, {end} of {cap}");
            }
        }

        #[test]
        fn no_other_ray_goes_higher(path in path(), idx in 0.0..1.0_f64, cap in 0.01..3.0_f64, ratio in 0.0..5.0_f64) {
            let intervals = grid(&path);
            let interval = intervals[(idx * intervals.len() as f64) as usize];
            let constraints = Constraints::<FEW>::of(&path.piece(interval.piece), &interval, &LIMITS, cap);
            prop_assert!(constraints.ray(ratio.max(LEAST_RATIO)).max <= constraints.highest_ray(cap).max * (1.0 + 1e-12));
        }
    }
}
