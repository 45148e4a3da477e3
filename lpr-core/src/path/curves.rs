//! Curves of the grip, and the joint paths that follow them.

mod bezier;
mod follow;
mod linear;
mod screw;

pub use bezier::{BezierCurve, BezierSettings};
#[cfg(feature = "learn")]
pub(crate) use follow::follow;
#[cfg(feature = "sim")]
pub(crate) use linear::linear_path_in;
pub use linear::{LINEAR_STEPS, linear_path};
pub use screw::ScrewMotion;
