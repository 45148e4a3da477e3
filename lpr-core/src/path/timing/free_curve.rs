//! A smooth curve along a path that planners found: where it bends, it leaves the polyline, and is
//! checked anew.

use super::topp::SmoothPath;
use crate::path::joint_path::JointPath;
use crate::robot::JointConfig;
use crate::scene::MotionChecker;

/// Longest pieces of the polyline between two knots of the curve, radians, the first that serves:
/// shorter ones keep closer to the polyline, and turn its corners slower.
const PIECES: [f32; 4] = [0.2, 0.1, 0.05, 0.025];
/// Configurations of the curve that are checked for each piece; between them it is all but straight.
const LOOKS: usize = 8;

/// The curve along a free path, itself free and within the joint limits; none if every one that was
/// tried touches something.
///
/// ```
/// use lpr_core::path::{JointPath, MotionLimits, SmoothPath, free_curve, time_optimal};
/// use lpr_core::robot::PANDA;
/// use lpr_core::scene::{ArmSpheres, MotionChecker, Scene};
///
/// let (scene, arm) = (Scene::empty(), ArmSpheres::new(&PANDA));
/// let at = |a: f32, b: f32| { let mut q = PANDA.start; (q[0], q[1]) = (a, b); q };
/// let corner = JointPath::new(vec![at(0.0, 0.0), at(1.0, 0.0), at(1.0, 0.5)])?;
/// let curve: SmoothPath = free_curve(&corner, &MotionChecker::new(&scene, &arm, 32.0)).unwrap();
/// let limits = MotionLimits { velocity: [2.0; 7], acceleration: [8.0; 7], jerk: None };
/// let seconds = time_optimal(&curve, &limits, None)?.duration_secs();
/// assert!(seconds > 1.0 && seconds < 2.0, "{seconds}");
/// # Ok::<(), lpr_core::Error>(())
/// ```
///
/// # Panics
///
/// When the arm has more than `N` joints.
#[must_use]
pub fn free_curve<const N: usize>(
    path: &JointPath,
    checker: &MotionChecker<'_>,
) -> Option<SmoothPath<N>> {
    PIECES.into_iter().find_map(|piece| {
        let n_pieces = libm::ceilf(path.length() / piece) as usize;
        let knots = path.subdivide(path.configs().len().max(n_pieces + 1));
        let curve = SmoothPath::through(&knots);
        let n_looks = LOOKS * (knots.configs().len() - 1);
        let dof = path.start().dof();
        let look = |i: usize| {
            let angles = curve.angles_at(curve.chord_length() * i as f64 / n_looks as f64);
            JointConfig::from_fn(dof, |j| angles[j] as f32)
        };
        let looks: Vec<JointConfig> = (0..=n_looks).map(look).collect();
        // A start may be beyond its limits: arms stop there, and are to come back.
        let is_inside = |config: &JointConfig| checker.arm().is_within_limits(config);
        let begins = looks.iter().position(is_inside).unwrap_or(looks.len());
        let stays = looks[begins..].iter().all(is_inside);
        (stays && checker.path_is_free(&looks)).then_some(curve)
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::robot::DOF;
    use crate::scene::stick_arm::{at, stick_arm};
    use crate::scene::{ArmSpheres, Primitive, Scene};

    /// The curve swings out at a corner: the ball is where that of the longest pieces would pass.
    #[test]
    fn a_curve_that_would_swing_into_something_keeps_closer_to_the_path() {
        let robot = stick_arm();
        let arm = ArmSpheres::new(&robot);
        let path = JointPath(vec![at(-0.8, 0.0), at(0.0, 0.0), at(0.0, 0.6)]);
        let deviation = |scene: &Scene| {
            let curve: Option<SmoothPath<DOF>> =
                free_curve(&path, &MotionChecker::new(scene, &arm, 32.0));
            curve.map(|curve| curve.deviation())
        };
        let in_the_open = deviation(&Scene::empty()).expect("nothing is in the way");
        // Just beyond where the hand turns.
        let hand = robot.grip(&at(0.0, 0.0)).translation;
        let near = (0..40_u8).map(|i| {
            let beyond = glamx::Vec3::new(0.0, 0.04 + 0.001 * f32::from(i), 0.0);
            Scene::from_primitives(vec![Primitive::Sphere { center: hand + beyond, radius: 0.002 }])
        });
        let free =
            near.filter(|scene| MotionChecker::new(scene, &arm, 32.0).path_is_free(path.configs()));
        let deviations: Vec<Option<f64>> = free.map(|scene| deviation(&scene)).collect();
        assert!(
            deviations.iter().flatten().any(|least| *least < 0.7 * in_the_open),
            "{deviations:?}"
        );
        assert_eq!(deviations.last(), Some(&Some(in_the_open)));
    }
}
