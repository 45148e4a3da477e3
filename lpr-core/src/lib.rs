//! C2F-ARM with Learned Path Ranking.

pub mod demo;
pub mod env;
pub mod error;
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

pub use error::{Error, Result};
pub use glam;
pub use glamx;
