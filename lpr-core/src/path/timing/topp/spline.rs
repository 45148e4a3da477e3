//! A twice continuously differentiable curve through the configurations of a path.
//!
//! A natural cubic spline over the chord length: second derivatives are zero at both ends and
//! follow from a tridiagonal system (de Boor, A Practical Guide to Splines, chapter IV).

use crate::path::joint_path::JointPath;
use crate::robot::{DOF, JointConfig};

/// Configurations nearer than this to the one before are left out, rad: the precision of f32 angles
/// says no direction there.
const SAME: f64 = 1e-6;

/// A smooth curve through the configurations of a [`JointPath`], from its exact start to its exact
/// goal.
///
/// `N` is the number of joints; an arm with fewer leaves the last of them at 0.
///
/// Between the configurations it leaves the polyline by up to [`Self::deviation`]: what was checked
/// against collisions on the polyline has to be checked on the curve, or with that margin.
///
/// ```
/// use lpr_core::path::{JointPath, SmoothPath};
/// use lpr_core::robot::JointConfig;
///
/// let corner = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0]].map(|[a, b]| JointConfig::new([a, b, 0.0, 0.0, 0.0, 0.0, 0.0]));
/// let curve = <SmoothPath>::through(&JointPath::new(corner.to_vec())?);
/// assert_eq!(curve.chord_length(), 2.0, "radians of the polyline");
/// assert_eq!(curve.angles_at(1.0)[..2], [1.0, 0.0], "through the corner");
/// // Beside the corner it swings out.
/// let aside = curve.angles_at(0.5)[1].abs();
/// assert!(aside > 0.01 && aside < curve.deviation());
/// # Ok::<(), lpr_core::Error>(())
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct SmoothPath<const N: usize = DOF> {
    pub(super) knots: Vec<Knot<N>>,
}

/// A configuration that the curve goes through.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Knot<const N: usize> {
    /// Chord length from the start, rad.
    pub(super) at: f64,
    pub(super) angles: [f64; N],
    /// Second derivatives by the chord length, 1/rad.
    bends: [f64; N],
}

/// The curve between two knots: angles and their derivatives by the chord length at its first knot.
#[derive(Debug, Clone, Copy)]
pub(super) struct Piece<const N: usize> {
    taylor: [[f64; N]; 4],
    pub(super) length: f64,
}

impl<const N: usize> SmoothPath<N> {
    /// The curve through `path`. Configurations within 1 µrad of another may be missed by 2 µrad.
    ///
    /// # Panics
    ///
    /// When the path's arm has more than `N` joints.
    #[must_use]
    pub fn through(path: &JointPath) -> Self {
        let dof = path.start().dof();
        assert!(dof <= N, "a curve of {N} joints, and a path of {dof}");
        let mut knots: Vec<_> = distinct(path.configs()).into_iter().map(Knot::new).collect();
        for i in 1..knots.len() {
            knots[i].at = knots[i - 1].at + distance(&knots[i - 1].angles, &knots[i].angles);
        }
        bend(&mut knots);
        Self { knots }
    }

    /// Sum of the chords between the configurations, rad: the range of the curve's parameter.
    #[must_use]
    pub fn chord_length(&self) -> f64 {
        self.knots[self.knots.len() - 1].at
    }

    /// The angles (rad) at `chord_length` radians from the start; those of the ends outside.
    #[must_use]
    pub fn angles_at(&self, chord_length: f64) -> [f64; N] {
        let last = self.knots[self.knots.len() - 1];
        if chord_length >= last.at {
            return last.angles;
        }
        let idx = self.piece_at(chord_length);
        self.piece(idx).angles(chord_length.max(0.0) - self.knots[idx].at)
    }

    /// A bound to the distance of the curve from the polyline through the same configurations, in
    /// joint space, rad.
    ///
    /// Sharp up to a factor of three.
    #[must_use]
    pub fn deviation(&self) -> f64 {
        self.knots.windows(2).map(|pair| deviation_between(&pair[0], &pair[1])).fold(0.0, f64::max)
    }

    /// Index of the piece that contains a chord length within the curve.
    pub(super) fn piece_at(&self, chord_length: f64) -> usize {
        let next = self.knots.partition_point(|knot| knot.at <= chord_length);
        next.clamp(1, self.knots.len() - 1) - 1
    }

    pub(super) fn piece(&self, idx: usize) -> Piece<N> {
        Piece::between(&self.knots[idx], &self.knots[idx + 1])
    }

    pub(super) fn n_pieces(&self) -> usize {
        self.knots.len() - 1
    }

    /// The same curve from its goal to its start.
    pub(super) fn reversed(&self) -> Self {
        let length = self.chord_length();
        Self {
            knots: self
                .knots
                .iter()
                .rev()
                .map(|knot| Knot { at: length - knot.at, ..*knot })
                .collect(),
        }
    }
}

impl<const N: usize> Knot<N> {
    const fn new(angles: [f64; N]) -> Self {
        Self { at: 0.0, angles, bends: [0.0; N] }
    }
}

impl<const N: usize> Piece<N> {
    fn between(from: &Knot<N>, to: &Knot<N>) -> Self {
        let length = to.at - from.at;
        let slope = |j: usize| {
            (to.angles[j] - from.angles[j]) / length
                - length * (2.0 * from.bends[j] + to.bends[j]) / 6.0
        };
        let third = |j: usize| (to.bends[j] - from.bends[j]) / length;
        let taylor =
            [from.angles, core::array::from_fn(slope), from.bends, core::array::from_fn(third)];
        Self { taylor, length }
    }

    /// Angles at `offset` from the first knot, rad.
    pub(super) fn angles(&self, offset: f64) -> [f64; N] {
        let [angle, first, second, third] = &self.taylor;
        core::array::from_fn(|j| {
            angle[j] + offset * (first[j] + offset * (second[j] / 2.0 + offset * third[j] / 6.0))
        })
    }

    /// First derivatives at `offset`.
    pub(super) fn first(&self, offset: f64) -> [f64; N] {
        let [_, first, second, third] = &self.taylor;
        core::array::from_fn(|j| first[j] + offset * (second[j] + offset * third[j] / 2.0))
    }

    /// Second derivatives at `offset`, 1/rad.
    pub(super) fn second(&self, offset: f64) -> [f64; N] {
        let [_, _, second, third] = &self.taylor;
        core::array::from_fn(|j| second[j] + offset * third[j])
    }

    /// Third derivatives, 1/rad².
    pub(super) const fn third(&self) -> &[f64; N] {
        &self.taylor[3]
    }
}

/// The configurations without those next to the one before; start and goal are exact. One when
/// nothing moves.
fn distinct<const N: usize>(configs: &[JointConfig]) -> Vec<[f64; N]> {
    let mut kept = vec![configs[0].to_array::<N>().map(f64::from)];
    for config in configs {
        let angles = config.to_array::<N>().map(f64::from);
        if distance(&kept[kept.len() - 1], &angles) > SAME {
            kept.push(angles);
        }
    }
    let goal = configs[configs.len() - 1].to_array::<N>().map(f64::from);
    while kept.len() > 1 && distance(&kept[kept.len() - 1], &goal) <= SAME {
        kept.pop();
    }
    if distance(&kept[kept.len() - 1], &goal) > 0.0 {
        kept.push(goal);
    }
    kept
}

fn distance<const N: usize>(a: &[f64; N], b: &[f64; N]) -> f64 {
    libm::sqrt(a.iter().zip(b).map(|(a, b)| (a - b) * (a - b)).sum())
}

/// Sets the second derivatives: elimination and back substitution of the tridiagonal system.
fn bend<const N: usize>(knots: &mut [Knot<N>]) {
    let n = knots.len();
    // Share of the next knot's bend in each knot's, after elimination.
    let mut shares = vec![0.0; n];
    for i in 1..n.saturating_sub(1) {
        let (before, after) = (knots[i].at - knots[i - 1].at, knots[i + 1].at - knots[i].at);
        let pivot = 2.0 * (before + after) - before * shares[i - 1];
        shares[i] = after / pivot;
        for j in 0..N {
            let turn = (knots[i + 1].angles[j] - knots[i].angles[j]) / after
                - (knots[i].angles[j] - knots[i - 1].angles[j]) / before;
            knots[i].bends[j] = (6.0 * turn - before * knots[i - 1].bends[j]) / pivot;
        }
    }
    for i in (1..n.saturating_sub(1)).rev() {
        for j in 0..N {
            knots[i].bends[j] -= shares[i] * knots[i + 1].bends[j];
        }
    }
}

/// Bound to the distance of a piece from its chord. Their difference is a cubic with inner Bézier
/// points `p` and `q` and none at the ends, whose weights sum to at most 3/4.
fn deviation_between<const N: usize>(from: &Knot<N>, to: &Knot<N>) -> f64 {
    let length = to.at - from.at;
    let norm = |near: &[f64; N], far: &[f64; N]| {
        libm::sqrt(
            near.iter().zip(far).map(|(near, far)| (2.0 * near + far) * (2.0 * near + far)).sum(),
        )
    };
    0.75 * length * length / 18.0 * norm(&from.bends, &to.bends).max(norm(&to.bends, &from.bends))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn path() -> impl Strategy<Value = JointPath> {
        prop::collection::vec(
            prop::array::uniform7(-3.0_f32..3.0).prop_map(JointConfig::new),
            2..20,
        )
        .prop_map(|configs| JointPath::new(configs).unwrap())
    }

    fn close(a: &[f64; DOF], b: &[f64; DOF], tolerance: f64) -> bool {
        a.iter().zip(b).all(|(a, b)| (a - b).abs() <= tolerance * (1.0 + a.abs()))
    }

    proptest! {
        #[test]
        fn the_curve_goes_through_every_configuration_with_two_continuous_derivatives(path in path()) {
            let smooth = <SmoothPath>::through(&path);
            prop_assert_eq!(smooth.knots.len(), path.configs().len());
            for (knot, config) in smooth.knots.iter().zip(path.configs()) {
                prop_assert!(close(&smooth.angles_at(knot.at), &config.to_array::<DOF>().map(f64::from), 1e-14));
            }
            for idx in 1..smooth.n_pieces() {
                let (before, after) = (smooth.piece(idx - 1), smooth.piece(idx));
                prop_assert!(close(&before.angles(before.length), &after.angles(0.0), 1e-12));
                prop_assert!(close(&before.first(before.length), &after.first(0.0), 1e-10));
                prop_assert!(close(&before.second(before.length), &after.second(0.0), 1e-9));
            }
            let last = smooth.piece(smooth.n_pieces() - 1);
            prop_assert_eq!(smooth.piece(0).second(0.0), [0.0; DOF]);
            prop_assert!(last.second(last.length).iter().all(|bend| bend.abs() < 1e-9));
        }

        #[test]
        fn the_deviation_bounds_the_distance_from_the_polyline_and_is_less_than_three_times_it(path in path()) {
            let smooth = <SmoothPath>::through(&path);
            let mut furthest = 0.0_f64;
            for pair in smooth.knots.windows(2) {
                for i in 0..=64 {
                    let share = f64::from(i) / 64.0;
                    let on_chord = core::array::from_fn(|j| pair[0].angles[j] + share * (pair[1].angles[j] - pair[0].angles[j]));
                    let on_curve = smooth.angles_at(pair[0].at + share * (pair[1].at - pair[0].at));
                    furthest = furthest.max(distance(&on_chord, &on_curve));
                }
            }
            prop_assert!(furthest <= smooth.deviation() * (1.0 + 1e-9) + 1e-12, "{furthest} of {}", smooth.deviation());
            prop_assert!(3.0 * furthest >= smooth.deviation() * (1.0 - 1e-3) - 1e-12, "{furthest} of {}", smooth.deviation());
        }

        #[test]
        fn reversing_keeps_the_curve(path in path(), share in 0.0..1.0_f64) {
            let smooth = <SmoothPath>::through(&path);
            let length = smooth.chord_length();
            let there = smooth.angles_at(share * length);
            prop_assert!(close(&smooth.reversed().angles_at(length - share * length), &there, 1e-12));
        }
    }

    #[test]
    fn a_polyline_along_a_line_stays_straight() {
        let at = |x: f32| JointConfig::new([x, -x, 0.5, 2.0 * x, 0.0, 0.0, x]);
        let smooth =
            <SmoothPath>::through(&JointPath::new([0.0, 0.25, 0.5, 2.0].map(at).to_vec()).unwrap());
        assert!(smooth.deviation() < 1e-15);
    }

    #[test]
    fn repeated_configurations_count_once_and_the_ends_are_exact() {
        let at = |x: f32| JointConfig::new([x, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]);
        let n_knots = |configs: &[f32]| {
            let smooth = <SmoothPath>::through(
                &JointPath::new(configs.iter().map(|x| at(*x)).collect()).unwrap(),
            );
            assert_eq!(smooth.angles_at(0.0)[0], f64::from(configs[0]));
            assert_eq!(
                smooth.angles_at(smooth.chord_length())[0],
                f64::from(configs[configs.len() - 1])
            );
            smooth.knots.len()
        };
        assert_eq!(n_knots(&[1.0, 1.0, 1.0]), 1);
        assert_eq!(n_knots(&[1.0, 1.0, 2.0, 2.0, 2.0, 3.0, 3.0]), 3);
        assert_eq!(n_knots(&[0.0, 1e-7]), 2, "a way of 0.1 µrad is a way");
        assert_eq!(
            n_knots(&[0.0, 1.5e-6, 7e-7]),
            2,
            "the goal takes the place of what is next to it"
        );
        assert_eq!(n_knots(&[0.0, 1.5e-6, 0.0]), 3);
        assert_eq!(n_knots(&[0.0, 1.0, 1.0 + 5e-7]), 2);
    }
}
