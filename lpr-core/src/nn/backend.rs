//! The choice of what computes the tensors.

use crate::check::one_of;
use crate::error::{Error, Result};

use burn::tensor::Device;
use serde::{Deserialize, Serialize};

/// The library that computes the tensors.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, strum::IntoStaticStr)]
#[strum(serialize_all = "snake_case")]
#[serde(rename_all = "snake_case")]
pub enum Backend {
    /// burn-flex: matrix products in pure Rust, natively and in wasm.
    Flex,
    /// burn-ndarray: a second opinion on small networks.
    #[cfg(feature = "ndarray")]
    Ndarray,
}

impl Backend {
    /// All that this build has; the first is the default.
    pub const ALL: &[Self] = &[
        Self::Flex,
        #[cfg(feature = "ndarray")]
        Self::Ndarray,
    ];

    /// Name on the command line.
    #[must_use]
    pub fn name(self) -> &'static str {
        self.into()
    }

    /// The backend of that name.
    ///
    /// # Errors
    ///
    /// [`Error::Config`] when there is none of that name, or this build leaves it out.
    pub fn by_name(name: &str) -> Result<Self> {
        let backend = Self::ALL.iter().find(|backend| backend.name() == name);
        backend.copied().ok_or_else(|| {
            let is_left_out = name == "ndarray";
            let why = if is_left_out { " (built without the feature ndarray)" } else { "" };
            let known = Self::ALL.iter().map(|backend| backend.name());
            Error::Config(format!("backend: {}{why}", one_of(known, name)))
        })
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
