//! What the arm must not hit.

mod shape;

pub use shape::{Part, Shape};
