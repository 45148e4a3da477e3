//! The choice of what computes the tensors.

use crate::error::{Error, Result};

use burn::tensor::Device;
use serde::{Deserialize, Serialize};

/// The library that computes the tensors.
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
