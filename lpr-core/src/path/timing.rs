//! When a path is where.

mod motion_limits;
mod point_to_point;
mod timed_path;
mod topp;
mod trajectory;

pub use motion_limits::{GripSpeedLimit, MotionLimits};
pub use point_to_point::{NoMotion, point_to_point};
pub use timed_path::{TimedPath, TimingSettings};
pub use topp::{SmoothPath, time_optimal};
pub use trajectory::{JointState, Trajectory};
