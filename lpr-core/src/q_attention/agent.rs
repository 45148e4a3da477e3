//! The agent: one online and one target network per depth, acting from the coarse grid to the fine
//! one, learning by updates.

mod learning;

pub use learning::UpdateReport;

use super::action::{ActionCodec, DiscreteAction, canonical};
use super::grasp::Hand;
use super::loss::{Choices, chosen_values};
use super::network::{ArmInput, DepthInput, NetworkCost, NetworkInput, QNetwork, QValues};
use super::next_best_pose::NextBestPose;
use super::observation::QObservation;
use super::position::mean_around;
use super::settings::{Imitation, Position, QAttentionSettings};
use crate::error::{Error, Result};
use crate::nn::{
    Adam, AdamSettings, AdamState, Backend, GradientClip, NamedTensor, export, import, ints,
    values as floats,
};
use crate::perception::{Proprio, VoxelBounds, VoxelGrid, VoxelIndex, VoxelSpace};
use crate::rng::Rng;
use crate::robot::Gripper;

use burn::tensor::Device;
use glamx::{Pose3, Vec3};
use serde::{Deserialize, Serialize};

/// Coarse-to-fine Q-attention.
#[derive(Debug, Clone)]
pub struct QAttention {
    settings: QAttentionSettings,
    codec: ActionCodec,
    depths: Vec<Depth>,
    device: Device,
}

/// The networks of one depth and their optimiser.
#[derive(Debug, Clone)]
struct Depth {
    online: QNetwork,
    target: QNetwork,
    adam: Adam,
}

/// The choice between the two networks of a depth.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ActingNetwork {
    /// The one that gradients change (the paper's choice).
    Online,
    /// The running mean of it, whose choices change less from one update to the next.
    Target,
}

impl ActingNetwork {
    /// An online and a target network: the one that acts first. Its own inverse.
    pub(crate) fn acting_first<T>(self, [online, target]: [T; 2]) -> [T; 2] {
        match self {
            Self::Online => [online, target],
            Self::Target => [target, online],
        }
    }
}

impl Depth {
    fn network(&self, weights: ActingNetwork) -> &QNetwork {
        match weights {
            ActingNetwork::Online => &self.online,
            ActingNetwork::Target => &self.target,
        }
    }
}

/// The agent's choice, with the values behind it.
#[derive(Debug, Clone)]
pub struct QDecision {
    /// The pose to go to.
    pub goal: NextBestPose,
    /// The same as bins.
    pub action: DiscreteAction,
    /// Mean value of what the last depth chose.
    pub value: f32,
    /// Input and values of each depth.
    pub depths: Vec<DepthDecision>,
    /// Values of the rotation bins: roll, pitch, yaw.
    pub rotation_values: [Vec<f32>; 3],
    /// Values of closing and of opening the gripper.
    pub gripper_values: [f32; 2],
}

/// Input and values of one depth.
#[derive(Debug, Clone)]
pub struct DepthDecision {
    /// The voxelised scene or cube.
    pub grid: VoxelGrid,
    /// Value of every voxel, in the order of [`VoxelSpace::flat_from_voxel`](crate::perception::VoxelSpace::flat_from_voxel).
    pub values: Vec<f32>,
}

/// Weights and optimisers of all depths.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct QAttentionState {
    /// One entry a depth.
    pub depths: Vec<DepthState>,
}

/// Learned numbers of one depth.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DepthState {
    /// The network that gradients change.
    pub online: Vec<NamedTensor>,
    /// Its running mean.
    pub target: Vec<NamedTensor>,
    /// The optimiser.
    pub adam: AdamState,
}

impl QAttention {
    /// An agent with fresh weights for the scene within `bounds`.
    ///
    /// # Errors
    ///
    /// When the settings do not fit together, or `bounds` has no volume.
    pub fn new(
        settings: QAttentionSettings,
        bounds: VoxelBounds,
        backend: Backend,
        rng: &mut Rng,
    ) -> Result<Self> {
        let codec = ActionCodec::new(&settings, bounds)?;
        let device = backend.device();
        let clip = settings.gradient_clip.map_or(GradientClip::None, GradientClip::Value);
        let adam =
            AdamSettings { learning_rate: settings.learning_rate, l2: settings.weight_decay, clip };
        let depths = (0..codec.n_depths())
            .map(|depth_idx| {
                let online = QNetwork::new(&settings, depth_idx, &device, rng);
                Depth { target: online.clone(), adam: Adam::new(adam, &online), online }
            })
            .collect();
        Ok(Self { settings, codec, depths, device })
    }

    /// The code of actions.
    #[must_use]
    pub fn codec(&self) -> &ActionCodec {
        &self.codec
    }

    /// Cost of each depth's network.
    #[must_use]
    pub fn costs(&self) -> Vec<NetworkCost> {
        self.depths.iter().map(|depth| depth.online.cost()).collect()
    }

    /// The best next pose for an observation: at every depth the voxel of highest value, at the
    /// last depth also the best rotation bins and gripper command.
    #[must_use]
    pub fn act(&self, observation: &QObservation, weights: ActingNetwork) -> QDecision {
        self.act_guided(observation, weights, &[])
    }

    /// [`Self::act`] when every depth but the first looks where the voxels of `guide` lead, one a
    /// depth: what a depth chooses when those before it were right. The pose is that of the last
    /// depth's choice.
    #[must_use]
    pub fn act_guided(
        &self,
        observation: &QObservation,
        weights: ActingNetwork,
        guide: &[VoxelIndex],
    ) -> QDecision {
        let mut depths = Vec::with_capacity(self.depths.len());
        let mut voxels = Vec::with_capacity(self.depths.len());
        // Depth 0 sees the whole scene, wherever this is.
        let (mut center, mut point) = (Vec3::ZERO, Vec3::ZERO);
        let mut last = None;
        for (depth_idx, depth) in self.depths.iter().enumerate() {
            let space =
                self.codec.zoom(depth_idx, center).expect("there is a space for each depth");
            let grid = |space| VoxelGrid::voxelise(observation.colored_points(), space);
            let arm = ArmInput::new(&self.settings, depth_idx, &observation.proprio, None);
            let seen = [self.seen(depth_idx, space, grid, arm)];
            let network = depth.network(weights);
            let values = network.forward(NetworkInput::new(network, &seen, &self.device));
            let best = Choices::best(&values);
            let voxel = space.voxel_from_flat(ints(best.voxel.clone())[0]);
            let translation = floats(values.translation.clone());
            point = self.position(&space, &translation, voxel);
            center = space.point_from_voxel(guide.get(depth_idx).copied().unwrap_or(voxel));
            voxels.push(voxel);
            let [DepthInput { grid, .. }] = seen;
            depths.push(DepthDecision { grid, values: translation });
            last = Some((values, best));
        }
        let (values, best) = last.expect("there is at least one depth");
        let decision = self.decision(observation, depths, voxels, values, &best);
        let pose = Pose3::from_parts(point, decision.goal.pose.rotation);
        QDecision { goal: NextBestPose { pose, ..decision.goal }, ..decision }
    }

    /// Everything that learns: what a checkpoint holds.
    #[must_use]
    pub fn state(&self) -> QAttentionState {
        let depths = self.depths.iter().map(|depth| DepthState {
            online: export(&depth.online),
            target: export(&depth.target),
            adam: depth.adam.state().clone(),
        });
        QAttentionState { depths: depths.collect() }
    }

    /// Goes on from `state`, bit by bit.
    ///
    /// # Errors
    ///
    /// When the state is of networks with other settings; the agent is then unchanged.
    pub fn restore(&mut self, state: &QAttentionState) -> Result<()> {
        if state.depths.len() != self.depths.len() {
            let (expected, found) = (self.depths.len(), state.depths.len());
            return Err(Error::Checkpoint(format!(
                "Q-attention: expected {expected} depths, found {found}"
            )));
        }
        let restored = self.depths.iter().zip(&state.depths).map(|(depth, state)| {
            let mut adam = depth.adam.clone();
            adam.restore(&state.adam)?;
            let online = import(depth.online.clone(), &state.online)?;
            let target = import(depth.target.clone(), &state.target)?;
            Ok(Depth { online, target, adam })
        });
        self.depths = restored.collect::<Result<_>>()?;
        Ok(())
    }

    /// What an agent goes to whose hand is as `proprio` says when its networks say `goal`.
    #[must_use]
    pub fn acted(&self, goal: NextBestPose, proprio: &Proprio) -> NextBestPose {
        let rotation = self.settings.half_turn.acted(goal.pose.rotation, Hand::of(proprio));
        let pose = Pose3::from_parts(goal.pose.translation, canonical(rotation));
        NextBestPose { pose, ..goal }
    }

    /// What its networks learn to say where a hand as `proprio` says went to `goal`.
    #[must_use]
    pub fn label(&self, goal: NextBestPose, proprio: &Proprio) -> NextBestPose {
        let rotation = self.settings.half_turn.label(goal.pose.rotation, Hand::of(proprio));
        let pose = Pose3::from_parts(goal.pose.translation, rotation);
        NextBestPose { pose, ..goal }
    }

    /// What a depth sees with `space` as its own, where `grid` voxelises the observation.
    fn seen(
        &self,
        depth_idx: usize,
        space: VoxelSpace,
        grid: impl Fn(VoxelSpace) -> VoxelGrid,
        arm: ArmInput,
    ) -> DepthInput {
        let wide = self.settings.wide_half_width.filter(|_| depth_idx > 0).map(|half_width| {
            let center = space.bounds().min + 0.5 * space.bounds().size;
            VoxelSpace::new(VoxelBounds::cube(center, half_width), space.voxels_per_side())
                .expect("half widths are positive and counts those of the scene")
        });
        DepthInput { grid: grid(space), wide: wide.map(grid), arm }
    }

    /// Where the agent goes within `best` of the last depth.
    fn position(&self, space: &VoxelSpace, values: &[f32], best: VoxelIndex) -> Vec3 {
        match (self.settings.position, self.settings.imitation) {
            (Position::Interpolated, Some(Imitation { temperature, .. })) => {
                mean_around(space, values, best, temperature)
            }
            _ => space.point_from_voxel(best),
        }
    }

    /// The nearest pose to `goal` that the agent could choose; none outside the bounds.
    #[must_use]
    pub fn quantise(&self, goal: &NextBestPose) -> Option<NextBestPose> {
        let quantised = self.codec.quantise(goal)?;
        let translation = match self.settings.position {
            Position::Voxel => quantised.pose.translation,
            Position::Interpolated => goal.pose.translation,
        };
        let pose = Pose3::from_parts(translation, quantised.pose.rotation);
        Some(NextBestPose { pose, ..quantised })
    }

    fn decision(
        &self,
        observation: &QObservation,
        depths: Vec<DepthDecision>,
        voxels: Vec<VoxelIndex>,
        values: QValues,
        best: &Choices,
    ) -> QDecision {
        let value = floats(chosen_values(&values, best).mean())[0];
        let pose = values.pose.expect("the last depth values rotation and gripper");
        let (bins, command) =
            best.pose.clone().expect("the last depth chooses rotation and gripper");
        let bins = ints(bins);
        let gripper = if ints(command)[0] == OPEN { Gripper::Open } else { Gripper::Close };
        let action = DiscreteAction { voxels, rotation: [bins[0], bins[1], bins[2]], gripper };
        let rotation = floats(pose.rotation);
        let per_axis = |axis: usize| {
            let n_bins = self.codec.rotation.n_bins;
            rotation[axis * n_bins..(axis + 1) * n_bins].to_vec()
        };
        let gripper = floats(pose.gripper);
        QDecision {
            goal: self.acted(self.codec.decode(&action), &observation.proprio),
            action,
            value,
            depths,
            rotation_values: [0, 1, 2].map(per_axis),
            gripper_values: [gripper[0], gripper[1]],
        }
    }
}

/// Index of [`Gripper::Open`] among the gripper's values.
const OPEN: usize = 1;
