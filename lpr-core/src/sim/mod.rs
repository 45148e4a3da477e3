//! The simulator: scenes as data, a rapier3d world with a kinematic arm, tasks and the environment over them.

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
