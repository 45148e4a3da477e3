//! The generators of paths by name.

/// Which generator made a path.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, strum::IntoStaticStr)]
#[strum(serialize_all = "snake_case")]
pub enum Source {
    /// `RRTConnect` to a sampled goal configuration (`m` in the paper).
    Planner,
    /// A quadratic Bézier curve through inverse kinematics (`b` in the paper).
    Bezier,
    /// The learned path policy (`π` in the paper).
    Policy,
    /// A straight line of the grip (the baseline's first try).
    Linear,
    /// The screw motion of the grip to the goal (beyond the paper).
    Screw,
}

impl Source {
    /// A fixed word for files and counting.
    #[must_use]
    pub fn name(self) -> &'static str {
        self.into()
    }
}
