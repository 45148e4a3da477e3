//! The simulator: scenes as data, a rapier3d world with a kinematic arm, tasks and the environment
//! over them.
//!
//! ```
//! use lpr_core::path::JointPath;
//! use lpr_core::robot::{Gripper, XARM7};
//! use lpr_core::sim::tasks::Task;
//! use lpr_core::sim::{SimEnvironment, SimParams};
//!
//! let task = Task::by_name("open_box")?;
//! let mut env = SimEnvironment::new(&task, &XARM7, 0, &["front", "wrist"], &SimParams::STANDARD)?;
//! let observation = env.observe(); // colour, depth and points of both cameras
//! let snapshot = env.clone(); // goes on bit for bit
//! let mut raised = XARM7.start;
//! raised[1] -= 0.2;
//! let result = env.step(&JointPath::new(vec![XARM7.start, raised])?, Gripper::Close);
//! assert!(result.invalid.is_none() && env.world().hash() != snapshot.world().hash());
//! # Ok::<(), lpr_core::Error>(())
//! ```

mod demo_plan;
mod demonstrating;
mod environment;
mod observing;
mod placement;
mod scene;
pub mod tasks;
#[cfg(test)]
mod tests;
mod vector;
mod world;

pub use demo_plan::DemoPlan;
pub use demonstrating::feasibility;
#[cfg(feature = "learn")]
pub use demonstrating::recording;
pub use demonstrating::{Demonstration, demonstrate};
pub use environment::{ControlAction, SimEnvironment};
pub use observing::{CameraRequest, MaskLabel, Randomization, Sensing, render};
pub use placement::{PlacedTask, Rejected, place};
pub use scene::{BodyKind, BodySpec, Condition, JointKind, JointSpec, Latch, SceneSpec, Zone};
pub use vector::{MacroAction, VectorEnvironment};
pub use world::{ArmSweep, Grasp, SimParams, World};
