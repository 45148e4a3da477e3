//! The simulator: scenes as data, a rapier3d world with a kinematic arm, tasks and the environment
//! over them.
//!
//! ```
//! use lpr_core::env::Environment as _;
//! use lpr_core::path::JointPath;
//! use lpr_core::robot::{Gripper, XARM7};
//! use lpr_core::sim::tasks::Task;
//! use lpr_core::sim::{SimEnvironment, SimParams};
//!
//! let task = Task::by_name("open_box")?;
//! let mut env = SimEnvironment::new(task, &XARM7, 0, &["front", "wrist"], &SimParams::STANDARD)?;
//! let observation = env.observe(); // colour, depth and points of both cameras
//! let snapshot = env.clone(); // goes on bit for bit
//! let mut raised = XARM7.start;
//! raised[1] -= 0.2;
//! let result = env.step(&JointPath::new(vec![XARM7.start, raised])?, Gripper::Close);
//! assert!(result.invalid.is_none() && env.world().hash() != snapshot.world().hash());
//! # Ok::<(), lpr_core::Error>(())
//! ```

mod arm;
mod contact;
mod control;
mod demonstrator;
mod env;
mod fallen;
pub mod feasibility;
#[cfg(test)]
mod grasps;
mod gripper;
mod near;
mod observing;
mod params;
mod physics;
mod placement;
mod randomization;
#[cfg(feature = "learn")]
pub mod recording;
pub mod render;
mod scene_spec;
mod snapshot;
mod sweep;
pub mod tasks;
mod vector;
mod world;

pub use control::ControlAction;
pub use demonstrator::{DemoPlan, Demonstration, demonstrate};
pub use env::SimEnvironment;
pub use observing::{CameraRequest, Seen};
pub use params::SimParams;
pub use placement::{PlacedTask, Rejected, place};
pub use randomization::{Randomization, Sensing};
pub use scene_spec::{BodyKind, BodySpec, Condition, JointKind, JointSpec, Latch, SceneSpec, Zone};
pub use sweep::ArmSweep;
pub use vector::{MacroAction, VectorEnvironment};
pub use world::{Holding, World};
