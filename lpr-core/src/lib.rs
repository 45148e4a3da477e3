//! C2F-ARM with Learned Path Ranking.

pub mod error;
pub mod path;
pub mod perception;
pub mod q_attention;
pub mod rng;
pub mod robot;
pub mod scene;
pub mod sim;

pub use error::{Error, Result};
pub use glam;
pub use glamx;
