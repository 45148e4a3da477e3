//! The simulator: scenes as data, a rapier3d world with a kinematic arm, tasks and the environment over them.

mod arm;
mod contact;
mod gripper;
mod params;
mod physics;
pub mod render;
mod scene_spec;
pub mod tasks;
mod world;

pub use params::SimParams;
pub use scene_spec::{BodyKind, BodySpec, Condition, JointKind, JointSpec, SceneSpec, Zone};
pub use world::{Holding, World};
