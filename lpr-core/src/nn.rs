//! Tensor building blocks: device, layers with seeded weights, named parameters, Adam.
//!
//! Networks rest on a plain device and become autodiff leaves for one update only
//! (`Module::train`), so that acting never records a graph. Adam is our own: it works on the same
//! flat vectors that a checkpoint stores, and resumes bit by bit.

mod adam;
mod backend;
#[cfg(test)]
pub(crate) mod golden;
mod halves;
mod kernels;
mod layers;
mod operations;
mod parameters;
mod values;

pub use adam::{AdamSettings, AdamState, GradientClip};
pub use backend::Backend;
pub use parameters::NamedTensor;

pub(crate) use adam::{Adam, parameter_gradients};
pub(crate) use halves::{ParameterGradients, in_halves, sum_of_gradients};
pub(crate) use layers::{Dense, Mlp, Spread};
pub(crate) use operations::{Activation, Padding, Tiles, Windows, convolve, dense};
pub(crate) use parameters::{export, import, mix};
pub(crate) use values::{ints, tensor, values};
