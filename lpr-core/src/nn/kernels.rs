//! What networks spend their time on, as plain functions on slices.
//!
//! Rows are samples, cells or configurations, channels stand last. Every function takes the machine's
//! vectors as a `Level`. Its sums do not depend on the number of threads, and those of a row not on
//! the rows beside it; vectors of another width may order them otherwise and fuse multiplication
//! and addition. [`super::operations`] makes differentiable operations of them.

pub(super) mod dense;
mod matmul;
pub(super) mod pooled;
pub(super) mod strided;
#[cfg(test)]
mod tests;
pub(super) mod tiles;
pub(super) mod winograd;

pub(crate) use matmul::Activation;
