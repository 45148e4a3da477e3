//! Paths of the arm: what generates, checks, times and collects them.

mod candidates;
mod curves;
mod joint_path;
mod planners;
mod rejection;
mod source;
mod timing;

pub use candidates::{
    CandidatePath, CandidateSet, CandidateSettings, CandidateStreams, PathQuery, PathSampler,
    Refinement, RejectedPath, SampledPaths, c2farm_path, candidates, linear_candidate,
};
#[cfg(feature = "learn")]
pub(crate) use curves::follow;
#[cfg(feature = "sim")]
pub(crate) use curves::linear_path_in;
pub use curves::{BezierCurve, BezierSettings, LINEAR_STEPS, ScrewMotion, linear_path};
pub use joint_path::JointPath;
pub use planners::{
    FINER, Plan, PlannerKind, PlannerSettings, RrtSettings, plan_with, rrt_connect, shortcut,
    simplify,
};
#[cfg(feature = "planners")]
pub use planners::{
    KpieceSettings, SblSettings, StompSettings, TrajoptSettings, kpiece, sbl, stomp, trajopt,
};
pub use rejection::Rejection;
pub use source::Source;
pub use timing::{
    GripSpeedLimit, JointState, MotionLimits, SmoothPath, TimedPath, TimingSettings, Trajectory,
    free_curve, time_optimal,
};
