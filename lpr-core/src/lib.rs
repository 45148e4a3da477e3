//! C2F-ARM with Learned Path Ranking: robot arms that learn manipulation from a few demonstrations.
//!
//! 1. Cameras give an [`perception::Observation`].
//! 2. Q-attention voxelises it, zooms in and names the next-best pose: [`q_attention`].
//! 3. The cloud becomes obstacles: [`scene::obstacle_scene`].
//! 4. Planner, Bézier curves and path policy propose paths to the pose: [`path::candidates()`].
//! 5. The ranker values each of them, and the best is taken.
//! 6. An [`env::Environment`] times and executes it.
//! 7. What came of it enters the replay.
//! 8. All networks learn from it.
//!
//! Metres, radians, seconds; the world is the base of the arm, z up, the table top at z = 0.
//!
//! ```
//! use lpr_core::robot::XARM7;
//!
//! let grip = XARM7.grip(&XARM7.start);
//! let again = XARM7.ik_nearest(&grip, &XARM7.start).expect("the start is within reach");
//! assert!(XARM7.grip(&again).translation.distance(grip.translation) < 1e-4);
//! ```

#[cfg(feature = "learn")]
pub mod agent;
mod check;
#[cfg(feature = "learn")]
pub mod checkpoint;
#[cfg(feature = "learn")]
pub mod config;
pub mod demo;
#[cfg(all(feature = "learn", feature = "sim"))]
pub mod diagnose;
pub mod digest;
pub mod env;
pub mod error;
#[cfg(feature = "learn")]
pub mod evaluate;
#[cfg(feature = "learn")]
mod features;
mod in_order;
mod lanes;
#[cfg(feature = "learn")]
pub mod learner;
#[cfg(feature = "learn")]
pub mod method;
#[cfg(feature = "learn")]
pub mod networks;
#[cfg(feature = "learn")]
pub mod nn;
pub mod path;
pub mod perception;
#[cfg(feature = "learn")]
pub mod policy;
pub mod q_attention;
#[cfg(feature = "learn")]
pub mod ranker;
#[cfg(feature = "learn")]
pub mod replay;
pub mod rng;
pub mod robot;
pub mod scene;
#[cfg(any(feature = "learn", feature = "sim"))]
mod sealed;
#[cfg(feature = "sim")]
pub mod sim;
pub mod toy;
#[cfg(feature = "learn")]
pub mod train;

pub use error::{Error, Result};
pub use glam;
pub use glamx;

/// Digest of the sources and presets of this crate and, in a checkout, of the versions of its
/// dependencies: what decides a result beside its settings.
pub const SOURCE_DIGEST: &str = env!("LPR_SOURCE_DIGEST");

#[cfg(doctest)]
#[doc = include_str!("../README.md")]
mod readme {}
