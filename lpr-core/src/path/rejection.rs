//! Reasons for which there is no path.

/// Reason why a generator produced no path: a value that users see, never an error.
///
/// ```
/// use lpr_core::glamx::{Pose3, Vec3};
/// use lpr_core::path::{Rejection, linear_path};
/// use lpr_core::robot::XARM7;
///
/// let mut goal = XARM7.grip(&XARM7.start);
/// goal.translation += Vec3::new(1.0, 0.0, 0.0);
/// let reason = linear_path(&XARM7, &XARM7.start, &goal).unwrap_err();
/// assert_eq!(reason.name(), "curve_unreachable");
/// assert!(matches!(reason, Rejection::CurveUnreachable { fraction } if fraction > 0.1 && fraction < 0.9));
/// ```
#[derive(Debug, Clone, Copy, PartialEq, strum::IntoStaticStr)]
#[strum(serialize_all = "snake_case")]
pub enum Rejection {
    /// The goal pose has no solution within the joint limits.
    Unreachable,
    /// The curve left what the arm can reach at `fraction` of its way.
    CurveUnreachable {
        /// Fraction of the curve that was followed, 0 to 1.
        fraction: f32,
    },
    /// The arm would have to change its posture in a jump at `fraction` of the curve.
    BranchJump {
        /// Fraction of the curve that was followed, 0 to 1.
        fraction: f32,
    },
    /// The start touches the scene, so no collision-free path leaves it.
    StartCollides,
    /// Every goal configuration touches the scene.
    GoalCollides,
    /// The planner used up its iterations.
    IterationLimit,
    /// The caller stopped the planner.
    Stopped,
    /// No optimisation ended with a free path.
    OptimizationFailed,
    /// Fewer distinct goal configurations exist than were asked for.
    TooFewGoals,
    /// The policy's path is longer than the mean of the others (section IV-B).
    LongerThanMean,
    /// Every goal configuration, or the policy's path, is outside the joint limits; so is a start
    /// that is not finite.
    OutsideLimits,
}

impl Rejection {
    /// A fixed word for files and counting.
    #[must_use]
    pub fn name(self) -> &'static str {
        self.into()
    }
}
