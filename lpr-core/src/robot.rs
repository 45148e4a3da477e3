//! Robot arms ([`Robot`]): two that are built in, and any other from its description.
//!
//! The base is the world frame, z up, table top at z = 0.

mod built_in;
mod fit;
mod follower;
mod geometry;
#[cfg(test)]
mod golden;
mod gripper;
mod ik;
mod joint;
mod joint_config;
mod kinematics;
mod link;
mod mesh;
mod model;
mod moves;
mod panda;
mod recognise;
mod roster;
mod solid;
mod srdf;
mod surface;
mod urdf;
mod xarm7;
mod xml;

use crate::error::{Error, Result};

pub use fit::MAX_SPHERES;
pub(crate) use fit::cover_by_few;
pub use follower::Follower;
pub use geometry::{Finger, GripperBox, MAX_OVERSHOOT};
pub use gripper::{Gripper, GripperSpec};
pub use ik::{IkBranches, MAX_STEP_CHANGE};
pub use joint::{DhRow, Joint, JointMotion, JointOrigin};
pub use joint_config::{JointConfig, JointRanges, MAX_JOINTS};
pub use link::{Capsule, Link, Sphere};
pub use mesh::{MeshReader, Triangle};
pub use model::{DOF, HAND, N_LINKS, Robot};
pub(crate) use moves::Move;
pub use panda::PANDA;
pub use roster::ROBOTS;
pub use solid::{PlacedSolid, Solid};
pub use urdf::{Described, GroupFound, UrdfOptions};
pub use xarm7::XARM7;
pub use xml::decode_xml;
