//! Tensor building blocks: device, layers with seeded weights, named parameters, Adam.
//!
//! Networks rest on a plain device and become autodiff leaves for one update only
//! (`Module::train`), so that acting never records a graph. Adam is our own: it works on the same
//! flat vectors that a checkpoint stores, and resumes bit by bit.

mod adam;
mod features;
#[cfg(test)]
pub(crate) mod golden;
mod layers;
mod parameters;

pub use adam::{AdamSettings, AdamState, GradientClip};
pub use parameters::NamedTensor;

pub(crate) use adam::Adam;
pub(crate) use features::{GOAL_FEATURES, JointScale, POSE_FEATURES, goal_features, pose_features};
pub(crate) use layers::{Dense, Mlp, Spread};
pub(crate) use parameters::{export, import, mix};

use crate::error::{Error, Result};

use burn::tensor::{Device, Tensor, TensorData};
use serde::{Deserialize, Serialize};

/// What computes the tensors.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Backend {
    /// burn-flex: matrix products in pure Rust, natively and in wasm.
    Flex,
    /// burn-ndarray: a second opinion on small networks.
    #[cfg(feature = "ndarray")]
    Ndarray,
}

impl Backend {
    /// The backend of that name.
    ///
    /// # Errors
    ///
    /// [`Error::Config`] when there is none of that name, or this build leaves it out.
    pub fn by_name(name: &str) -> Result<Self> {
        match name {
            "flex" => Ok(Self::Flex),
            #[cfg(feature = "ndarray")]
            "ndarray" => Ok(Self::Ndarray),
            #[cfg(not(feature = "ndarray"))]
            "ndarray" => Err(Error::Config(
                "backend `ndarray`: this program was built without the feature `ndarray`"
                    .to_owned(),
            )),
            _ => Err(Error::Config(format!("unknown backend `{name}`, known: flex, ndarray"))),
        }
    }

    /// The plain device of the backend: the only place that names one.
    pub(crate) fn device(self) -> Device {
        match self {
            Self::Flex => Device::flex(),
            #[cfg(feature = "ndarray")]
            #[expect(
                deprecated,
                reason = "kept as a cross-check of burn-flex for as long as burn has it"
            )]
            Self::Ndarray => Device::ndarray(),
        }
    }
}

/// A tensor of `shape` from its values in row-major order.
pub(crate) fn tensor<const D: usize>(
    values: Vec<f32>,
    shape: [usize; D],
    device: &Device,
) -> Tensor<D> {
    Tensor::from_data(TensorData::new(values, shape), device)
}

/// The values of a tensor in row-major order.
pub(crate) fn values<const D: usize>(tensor: Tensor<D>) -> Vec<f32> {
    tensor.into_data().try_into_vec().expect("every float tensor of this crate holds f32")
}
