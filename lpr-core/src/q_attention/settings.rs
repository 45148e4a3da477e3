//! Every number of the Q-attention agent.

use super::grasp::HalfTurn;
use crate::check::{in_table, setting};
use crate::error::Result;

use glamx::Vec3;
use serde::{Deserialize, Serialize};

/// Settings of coarse-to-fine Q-attention (paper, section III; numbers of the released C2F-ARM in
/// each field's doc).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct QAttentionSettings {
    /// Voxels along each side of the grid, the same at every depth (released: 16).
    pub voxels_per_side: usize,
    /// Half side of the cube that each depth after the first looks at, metres; one entry a depth
    /// (paper: one; released: 0.15).
    pub zoom_half_widths: Vec<f32>,
    /// Bins of each Euler angle over the full circle; even (released: 72, 5° each).
    pub rotation_bins: usize,
    /// Discount of future reward, `γ` (released: 0.99).
    pub discount: f32,
    /// Step size of Adam (released: 5e-4).
    pub learning_rate: f32,
    /// L2 penalty of Adam (released: 1e-6).
    pub weight_decay: f32,
    /// Bound on every component of the gradient, or none (released: 0.01).
    pub gradient_clip: Option<f32>,
    /// Fraction of the online weights mixed into the target after every update, `τ` (released:
    /// 0.0025).
    pub target_mix: f32,
    /// Weight of the mean absolute value of all translation values, one entry a depth (released: 1
    /// each).
    ///
    /// It is what makes near voxels differ: a voxel that is right with probability `p` is worth
    /// `1 - w K / (V p)`, with `V` voxels and `K` parts of the action (1, at the last depth 5). A
    /// weight with `w K / (V p) > 1` for every voxel teaches nothing.
    pub translation_regularisation: Vec<f32>,
    /// Weight of the mean absolute value of all rotation and gripper values (released: 1); the same
    /// rule, over all their bins.
    pub rotation_regularisation: f32,
    /// Term of the loss for actions of successful episodes (paper: nothing).
    pub imitation: Option<Imitation>,
    /// Greatest random shift of the cube of a later depth from its label, as a fraction of its half
    /// width (released: 0.75).
    pub crop_jitter: f32,
    /// Half side of a wider cube around the same point that every depth after the first sees too,
    /// metres; none: it sees its own cube alone, where the way that a bottle has to point to a rack
    /// half a metre off does not show.
    #[serde(default)]
    pub wide_half_width: Option<f32>,
    /// Where in the best voxel of the last depth the agent goes.
    #[serde(default)]
    pub position: Position,
    /// What the place channels of a voxel tell.
    #[serde(default)]
    pub places: Places,
    /// What is done about the half turn of a two-finger grasp.
    #[serde(default)]
    pub half_turn: HalfTurn,
    /// Largest rotation about the vertical that a sampled observation and its action undergo,
    /// radians (released: 0).
    pub yaw_range: f32,
    /// Largest shift along x, y, z that a sampled observation and its action undergo, metres
    /// (released: 0).
    pub shift_range: Vec3,
    /// Motion of the pose that networks are told of the hand, while they learn.
    #[serde(default)]
    pub hand_jitter: Option<HandJitter>,
    /// The networks, one of the same kind per depth.
    pub network: NetworkSettings,
}

/// Random motion, in learning alone, of the pose that networks are told of the hand.
///
/// The agent itself has put the hand where it is, and in demonstrations it is always at the same
/// place before the same pose: networks that are told exactly where repeat their last error, above
/// the wrong thing or across it, instead of looking.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct HandJitter {
    /// Of a hand that holds nothing.
    pub free: Jitter,
    /// Of one that holds something: where that goes depends on how it is held.
    pub held: Jitter,
}

/// Largest motion of a pose.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Jitter {
    /// Along each axis, metres.
    pub shift: f32,
    /// About the vertical, radians.
    pub turn: f32,
}

/// What the three place channels of a voxel tell.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Places {
    /// Its index over the number of voxels, as in the released code.
    #[default]
    Grid,
    /// At depths after the first, where it is from the hand, in the hand's frame, while that holds
    /// something. A free hand is where the agent put it, and in demonstrations always at the same
    /// place before a grasp: told from there, networks repeat its error instead of looking.
    Held,
}

/// Where in its best voxel the agent goes.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Position {
    /// The centre.
    #[default]
    Voxel,
    /// The mean over it and its neighbours.
    Interpolated,
}

/// The cross-entropy of the actions of successful episodes, demonstrations first of all, under
/// `softmax(Q / T)`.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Imitation {
    /// Its weight in the loss.
    pub weight: f32,
    /// `T`: values of twice as likely voxels end up `T log 2` apart.
    pub temperature: f32,
}

impl Imitation {
    fn check(self) -> Result<()> {
        let Self { weight, temperature } = self;
        let is_weight = weight.is_finite() && weight >= 0.0;
        setting(is_weight, "imitation.weight", "a finite number from 0", weight)?;
        let is_temperature = temperature.is_finite() && temperature > 0.0;
        let expected = "a finite number above 0";
        setting(is_temperature, "imitation.temperature", expected, temperature)
    }
}

/// Kind and width of the network of one depth.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "snake_case", deny_unknown_fields)]
pub enum NetworkSettings {
    /// The 3-D U-Net of inception blocks of C2F-ARM.
    Paper {
        /// Channels at the finest grid (released: 64); the coarser grids have two and four times as
        /// many.
        channels: usize,
        /// Channels inside an inception block, before its 3³ convolutions (released: 32).
        bottleneck: usize,
        /// Hidden units of the rotation and gripper head (released: 128).
        hidden: usize,
    },
    /// A network of matrix products on 2³ blocks for two CPU cores.
    Fast {
        /// Channels of a cell on the grid of half the side.
        cell_channels: usize,
        /// Channels of a block on the grid of a quarter of the side.
        block_channels: usize,
        /// Channels of a block that the rotation head reads in place.
        head_channels: usize,
        /// Channels of what it reads around the attended voxel; 0: it does not.
        #[serde(default)]
        attended_channels: usize,
        /// Hidden units of the rotation and gripper head.
        hidden: usize,
        /// Harmonics of the full circle that the values of an Euler angle are made of.
        harmonics: usize,
    },
}

impl QAttentionSettings {
    /// Number of depths.
    #[must_use]
    pub fn n_depths(&self) -> usize {
        self.zoom_half_widths.len() + 1
    }

    /// Checks that the numbers fit together.
    ///
    /// # Errors
    ///
    /// [`Error::Config`](crate::Error::Config) naming the first setting that cannot work.
    pub fn check(&self) -> Result<()> {
        self.check_shapes()
            .and_then(|()| self.check_ranges())
            .and_then(|()| self.imitation.map_or(Ok(()), Imitation::check))
            .and_then(|()| self.check_position())
            .map_err(|error| in_table("q_attention", error))
    }

    fn check_shapes(&self) -> Result<()> {
        let is_sound = |n: usize| n >= 4 && n.is_multiple_of(4);
        let (side, bins) = (self.voxels_per_side, self.rotation_bins);
        setting(is_sound(side), "voxels_per_side", "a multiple of 4", side)?;
        setting(is_sound(bins), "rotation_bins", "a multiple of 4: right angles have bins", bins)?;
        let n = self.translation_regularisation.len();
        let one_a_depth = format!("{} numbers, one a depth", self.n_depths());
        setting(n == self.n_depths(), "translation_regularisation", &one_a_depth, n)
    }

    fn check_position(&self) -> Result<()> {
        let holds = self.position == Position::Voxel || self.imitation.is_some();
        setting(holds, "position", "imitation, which interpolation reads", "none")
    }

    fn check_ranges(&self) -> Result<()> {
        for (idx, half) in self.zoom_half_widths.iter().enumerate() {
            let holds = half.is_finite() && *half > 0.0;
            setting(holds, &format!("zoom_half_widths[{idx}]"), "a finite length above 0", half)?;
        }
        if let Some(half) = self.wide_half_width {
            let holds = half.is_finite() && half > 0.0;
            setting(holds, "wide_half_width", "a finite length above 0", half)?;
            let reads = matches!(self.network, NetworkSettings::Fast { .. });
            setting(reads, "wide_half_width", "a network of kind fast, which reads it", "paper")?;
        }
        // At 1 the label could lie outside the cube.
        let jitter = self.crop_jitter;
        setting((0.0..1.0).contains(&jitter), "crop_jitter", "from 0, below 1", jitter)?;
        if let Some(HandJitter { free, held }) = self.hand_jitter {
            for (name, range) in [
                ("hand_jitter.free.shift", free.shift),
                ("hand_jitter.free.turn", free.turn),
                ("hand_jitter.held.shift", held.shift),
                ("hand_jitter.held.turn", held.turn),
            ] {
                setting((0.0..=4.0).contains(&range), name, "from 0 to 4", range)?;
            }
        }
        for (name, share) in [("discount", self.discount), ("target_mix", self.target_mix)] {
            setting((0.0..=1.0).contains(&share), name, "0 to 1", share)?;
        }
        Ok(())
    }
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use crate::perception::Proprio;
    use crate::robot::PANDA;

    /// Small and quick settings.
    pub(in crate::q_attention) fn test_settings() -> QAttentionSettings {
        QAttentionSettings {
            voxels_per_side: 8,
            zoom_half_widths: vec![0.15],
            rotation_bins: 24,
            discount: 0.99,
            learning_rate: 2e-3,
            weight_decay: 0.0,
            gradient_clip: None,
            target_mix: 0.02,
            translation_regularisation: vec![1.0; 2],
            rotation_regularisation: 1.0,
            imitation: None,
            crop_jitter: 0.5,
            wide_half_width: None,
            position: Position::Voxel,
            places: Places::Grid,
            half_turn: HalfTurn::Relative,
            yaw_range: 0.5,
            shift_range: Vec3::new(0.1, 0.1, 0.0),
            hand_jitter: None,
            network: NetworkSettings::Fast {
                cell_channels: 8,
                block_channels: 12,
                head_channels: 4,
                attended_channels: 8,
                hidden: 16,
                harmonics: 4,
            },
        }
    }

    /// An arm at rest above the table.
    pub(in crate::q_attention) fn test_proprio() -> Proprio {
        Proprio {
            joints: PANDA.start,
            gripper_width: 0.08,
            gripper_open: 1.0,
            finger_positions: [0.04; 2],
            grip: PANDA.grip(&PANDA.start),
            time: 1.0,
        }
    }

    #[test]
    fn settings_that_cannot_work_are_named() {
        type Change = fn(&mut QAttentionSettings);
        let cases: [(Change, &str); 8] = [
            (|s| s.position = Position::Interpolated, "position"),
            (|s| s.voxels_per_side = 10, "voxels_per_side"),
            (|s| s.rotation_bins = 30, "rotation_bins"),
            (|s| s.zoom_half_widths = vec![0.0], "zoom_half_widths"),
            (|s| s.translation_regularisation = vec![1.0], "translation_regularisation"),
            (|s| s.crop_jitter = 1.0, "crop_jitter"),
            (|s| s.target_mix = 1.5, "target_mix"),
            (|s| s.imitation = Some(Imitation { weight: 1.0, temperature: 0.0 }), "imitation"),
        ];
        assert_eq!(test_settings().check(), Ok(()));
        for (change, name) in cases {
            let mut settings = test_settings();
            change(&mut settings);
            let error = settings.check().expect_err(name);
            assert!(error.to_string().contains(name), "{error}");
        }
    }
}
