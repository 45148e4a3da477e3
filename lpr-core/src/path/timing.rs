//! When a path is where: one timer for each use.
//!
//! | timer | for | called by | limits that it keeps |
//! | --- | --- | --- | --- |
//! | [`TimedPath`] | a path in the simulator: one trapezoid of speed along the polyline | `SimEnvironment`'s step, the emulated xArm7, the page's planner | every joint's velocity and acceleration on the segments; corners are passed at speed |
//! | [`time_optimal`] | the fastest motion along a smooth curve (TOPP-RA) | `lpr plan --timed`, `lpr-wasm`'s planner, `lpr bench` | every joint's velocity and acceleration and the grip's speed on all of the curve, jerk at its start and end |
//! | `schedule` of the xArm7's crate | the points that a real arm is sent, one a tick | `lpr xarm run` | every joint's velocity, and its acceleration across corners too; jerk is not bounded |
//! | `point_to_point` of the xArm7's crate (Ruckig) | motions from any state to rest, without a path between | nothing yet: it is for the arm's queued moves | every joint's velocity, acceleration and jerk |

mod free_curve;
mod joint_state;
mod motion_limits;
mod timed_path;
mod topp;

pub use free_curve::free_curve;
pub use joint_state::JointState;
pub use motion_limits::{GripSpeedLimit, MotionLimits};
pub use timed_path::{TimedPath, TimingSettings};
pub use topp::{SmoothPath, Trajectory, time_optimal};
