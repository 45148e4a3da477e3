//! The networks that value every voxel, rotation bin and gripper command of one depth.

mod blocks;
mod fast;
mod input;
mod layers;
mod paper;
mod unet;

use super::settings::{NetworkSettings, QAttentionSettings};
use crate::perception::VOXEL_CHANNELS;
use crate::rng::Rng;
pub use input::NetworkInput;
pub(super) use input::{ArmInput, DepthInput, HandMotion};
pub use unet::UNet;

use fast::{FastHeadSizes, FastNetwork, FastSizes};
use paper::{PaperNetwork, PaperSizes};

use burn::module::Module;
use burn::tensor::{Device, Tensor};

/// The values that the network of one depth gives.
#[derive(Debug, Clone)]
pub struct QValues {
    /// `[B, D H W]`: one value per voxel, x fastest.
    pub translation: Tensor<2>,
    /// Rotation and gripper, at the last depth only.
    pub pose: Option<PoseValues>,
}

/// Values of rotation bins and gripper commands.
#[derive(Debug, Clone)]
pub struct PoseValues {
    /// `[B, 3, R]`: Euler angles about x, y, z.
    pub rotation: Tensor<3>,
    /// `[B, 2]`: close, open.
    pub gripper: Tensor<2>,
}

/// Cost of one forward pass of one sample.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct NetworkCost {
    /// Trained numbers.
    pub parameters: usize,
    /// Floating-point operations: two a multiply-accumulate.
    pub flops: usize,
}

/// The network of one depth.
#[derive(Module, Debug)]
pub struct QNetwork {
    paper: Option<PaperNetwork>,
    fast: Option<FastNetwork>,
}

impl QNetwork {
    /// A network with fresh weights for a depth: voxels are valued at each, rotation and gripper at
    /// the last.
    #[must_use]
    pub fn new(
        settings: &QAttentionSettings,
        depth_idx: usize,
        device: &Device,
        rng: &mut Rng,
    ) -> Self {
        let side = settings.voxels_per_side;
        let has_head = depth_idx + 1 == settings.n_depths();
        let has_wide = depth_idx > 0 && settings.wide_half_width.is_some();
        let channels = VOXEL_CHANNELS * (1 + usize::from(has_wide));
        let rotation_bins = settings.rotation_bins;
        let proprio = input::n_proprio(settings.half_turn);
        match settings.network {
            NetworkSettings::Paper { channels, bottleneck, hidden } => {
                let rotation_bins = has_head.then_some(rotation_bins);
                let sizes =
                    PaperSizes { side, proprio, channels, bottleneck, hidden, rotation_bins };
                Self { paper: Some(PaperNetwork::new(sizes, device, rng)), fast: None }
            }
            NetworkSettings::Fast {
                cell_channels,
                block_channels,
                head_channels,
                attended_channels,
                hidden,
                harmonics,
            } => {
                let sizes = FastSizes { side, channels, proprio, cell_channels, block_channels };
                let head = FastHeadSizes {
                    head_channels,
                    attended_channels,
                    hidden,
                    rotation_bins,
                    harmonics,
                };
                let head = has_head.then_some(head);
                Self { paper: None, fast: Some(FastNetwork::new(sizes, head, device, rng)) }
            }
        }
    }

    /// Values of everything that can be chosen.
    #[must_use]
    pub fn forward(&self, input: NetworkInput) -> QValues {
        match (&self.paper, &self.fast) {
            (Some(paper), _) => paper.forward(input),
            (None, Some(fast)) => fast.forward(input),
            (None, None) => unreachable!("a network is one of the two kinds"),
        }
    }

    /// Flat index, x fastest, of the voxel that stands in each row of the input; none: its own.
    #[must_use]
    pub fn raster_of_row(&self) -> Option<&[usize]> {
        self.fast.as_ref().map(FastNetwork::raster_of_row)
    }

    /// Parameters, and operations of one forward pass of one sample.
    #[must_use]
    pub fn cost(&self) -> NetworkCost {
        let macs = self.paper.as_ref().map_or(0, PaperNetwork::macs)
            + self.fast.as_ref().map_or(0, FastNetwork::macs);
        NetworkCost { parameters: self.num_params(), flops: 2 * macs }
    }
}
