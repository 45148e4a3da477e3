//! Paths of the arm: what generates, checks, times and collects them.

mod candidates;
mod curves;
mod joint_path;
mod planners;
mod rejection;
mod source;
mod timing;

#[cfg(feature = "sim")]
pub(crate) use candidates::map_in_order;
pub use candidates::{
    CandidatePath, CandidateSet, CandidateSettings, CandidateStreams, PathQuery, RejectedPath,
    c2farm_path, candidates, linear_candidate,
};
#[cfg(feature = "sim")]
pub(crate) use curves::linear_path_in;
pub use curves::{BezierCurve, BezierSettings, LINEAR_STEPS, ScrewMotion, linear_path};
pub use joint_path::JointPath;
pub use planners::{
    FINER, KpieceSettings, Plan, PlannerKind, PlannerSettings, RrtSettings, SblSettings,
    StompSettings, TrajoptSettings, kpiece, plan_with, rrt_connect, sbl, shortcut, simplify, stomp,
    trajopt,
};
pub use rejection::Rejection;
pub use source::Source;
pub use timing::{
    GripSpeedLimit, JointState, MotionLimits, SmoothPath, TimedPath, TimingSettings, Trajectory,
    time_optimal,
};
