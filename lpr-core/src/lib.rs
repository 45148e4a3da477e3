//! C2F-ARM with Learned Path Ranking.

#[cfg(feature = "learn")]
pub mod agent;
#[cfg(feature = "learn")]
pub mod checkpoint;
#[cfg(feature = "learn")]
pub mod config;
pub mod demo;
pub mod env;
pub mod error;
#[cfg(feature = "learn")]
pub mod evaluate;
#[cfg(feature = "learn")]
pub mod learner;
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
#[cfg(feature = "sim")]
pub mod sim;
pub mod toy;
#[cfg(feature = "learn")]
pub mod train;

pub use error::{Error, Result};
pub use glam;
pub use glamx;
