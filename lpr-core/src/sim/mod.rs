//! The simulator.

pub mod render;
