//! The agent: one online and one target network per depth, acting from the coarse grid to the fine
//! one, learning by updates.

use super::action::{ActionCodec, DiscreteAction, nearest_grasp};
use super::batch::{Augmented, AugmentedLabel, QSample};
use super::loss::{Choices, LossWeights, PerSample, chosen_values, depth_loss, td_target};
use super::network::{Heads, NetworkCost, NetworkInput, QNetwork, QValues};
use super::next_best_pose::NextBestPose;
use super::observation::QObservation;
use super::settings::QAttentionSettings;
use crate::error::{Error, Result};
use crate::in_order::each_with_scratch;
use crate::nn::{
    Adam, AdamSettings, AdamState, Backend, GradientClip, NamedTensor, ParameterGradients, export,
    import, in_halves, mix, parameter_gradients, sum_of_gradients, tensor, values as floats,
};
use crate::perception::{VoxelBounds, VoxelGrid, VoxelIndex, VoxelSpace};
use crate::rng::Rng;
use crate::robot::Gripper;

use burn::module::Module as _;
use burn::tensor::{Device, Int, Tensor, TensorData};
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
    /// Value of every voxel, in the order of [`VoxelSpace::flat_from_voxel`].
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

impl DepthState {
    /// Its online and target network: the one that `acting` names first.
    #[must_use]
    pub fn acting_first(self, acting: ActingNetwork) -> [Vec<NamedTensor>; 2] {
        match acting {
            ActingNetwork::Online => [self.online, self.target],
            ActingNetwork::Target => [self.target, self.online],
        }
    }
}

/// Outcome of an update, for the log and the priorities of the replay.
#[derive(Debug, Clone, PartialEq)]
pub struct UpdateReport {
    /// Loss of each depth.
    pub losses: Vec<f32>,
    /// Mean over the batch of the value that the first depth regressed on.
    pub mean_target: f32,
    /// New priority of each sample before the replay's exponent.
    pub priorities: Vec<f32>,
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
        let n_depths = codec.n_depths();
        let depths = (0..n_depths)
            .map(|depth_idx| {
                let heads =
                    if depth_idx + 1 == n_depths { Heads::Pose } else { Heads::Translation };
                let online = QNetwork::new(&settings, heads, &device, rng);
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
            let grid = VoxelGrid::voxelise(observation.colored_points(), space);
            let network = depth.network(weights);
            let values = network.forward(NetworkInput::new(
                network,
                core::slice::from_ref(&grid),
                &[observation.proprio],
                &self.device,
            ));
            let best = Choices::best(&values);
            let voxel = space.voxel_from_flat(ints(best.voxel.clone())[0]);
            point = space.point_from_voxel(voxel);
            center = space.point_from_voxel(guide.get(depth_idx).copied().unwrap_or(voxel));
            voxels.push(voxel);
            depths.push(DepthDecision { grid, values: floats(values.translation.clone()) });
            last = Some((values, best));
        }
        let (values, best) = last.expect("there is at least one depth");
        let decision = self.decision(observation, depths, voxels, values, &best);
        let pose = Pose3::from_parts(point, decision.goal.pose.rotation);
        QDecision { goal: NextBestPose { pose, ..decision.goal }, ..decision }
    }

    /// Labels that training would draw for one demonstrated action: `n` augmentations of it.
    ///
    /// Those of an action outside the bounds of depth 0 are none.
    #[must_use]
    pub fn augmented_labels(
        &self,
        observation: &QObservation,
        action: NextBestPose,
        n: usize,
        rng: &mut Rng,
    ) -> Vec<AugmentedLabel> {
        let sample =
            QSample { observation, action, reward: 0.0, next: None, weight: 1.0, imitated: true };
        let draw = |_| Augmented::draw(sample, &self.codec, &self.settings, rng);
        (0..n).filter_map(draw).map(|augmented| augmented.label()).collect()
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
        let goal = self.codec.decode(&action);
        // Labels do not tell the two turns of a grasp apart; turning needlessly would twist what
        // the hand holds.
        let pose = nearest_grasp(goal.pose, observation.proprio.grip.rotation);
        QDecision {
            goal: NextBestPose { pose, ..goal },
            action,
            value,
            depths,
            rotation_values: [0, 1, 2].map(per_axis),
            gripper_values: [gripper[0], gripper[1]],
        }
    }

    /// One gradient step of every depth on a batch, then one step of the targets towards the new
    /// weights.
    ///
    /// # Panics
    ///
    /// When the batch is empty or an action lies outside the bounds of depth 0, which the caller
    /// keeps out of the replay.
    pub fn update(&mut self, batch: &[QSample<'_>], rng: &mut Rng) -> UpdateReport {
        assert!(!batch.is_empty(), "an update needs at least one sample");
        let batch = batch
            .iter()
            .map(|sample| {
                Augmented::draw(*sample, &self.codec, &self.settings, rng)
                    .expect("replayed actions lie within bounds")
            })
            .collect::<Vec<_>>();
        let halves = in_halves(&batch, |half| self.half(half, batch.len()));
        let n_depths = self.depths.len();
        let (mut losses, mut priorities) = (vec![0.0; n_depths], vec![0.0; batch.len()]);
        let mut gradients = vec![Vec::new(); n_depths];
        let mut hubers = vec![Vec::new(); n_depths];
        let mut sum_of_targets = 0.0;
        for half in halves {
            sum_of_targets += half.sum_of_targets;
            for (depth_idx, part) in half.depths.into_iter().enumerate() {
                losses[depth_idx] += part.loss;
                hubers[depth_idx].extend(part.huber);
                gradients[depth_idx].push(part.gradients);
            }
        }
        for (depth_idx, huber) in hubers.iter().enumerate() {
            add_priorities(&mut priorities, huber, n_depths - depth_idx);
        }
        self.step(gradients);
        UpdateReport { losses, mean_target: sum_of_targets / batch.len() as f32, priorities }
    }

    /// Line 17 of all depths: Adam's step, then the targets' towards the new weights.
    fn step(&mut self, gradients: Vec<Vec<ParameterGradients>>) {
        let target_mix = self.settings.target_mix;
        let depths = self.depths.iter_mut().zip(gradients).collect();
        each_with_scratch(
            depths,
            || (),
            |(), (depth, parts): (&mut Depth, _)| {
                depth.online = depth.adam.step(depth.online.clone(), sum_of_gradients(parts));
                depth.target = mix(depth.target.clone(), &depth.online, target_mix);
            },
        );
    }

    /// The part of some samples in the update of a batch of `n_samples`.
    fn half(&self, batch: &[Augmented<'_>], n_samples: usize) -> Half {
        // Where the online networks look next, for the samples that go on.
        let mut next_centers = vec![Vec3::ZERO; batch.len()];
        let mut sum_of_targets = 0.0;
        let mut depths = Vec::with_capacity(self.depths.len());
        for depth_idx in 0..self.depths.len() {
            let targets = self.targets(depth_idx, batch, &mut next_centers);
            if depth_idx == 0 {
                sum_of_targets = targets.iter().sum();
            }
            depths.push(self.fit(depth_idx, batch, targets, n_samples));
        }
        Half { sum_of_targets, depths }
    }

    /// The values to regress on at one depth. Moves `next_centers` to what the online network
    /// attends to.
    fn targets(
        &self,
        depth_idx: usize,
        batch: &[Augmented<'_>],
        next_centers: &mut [Vec3],
    ) -> Vec<f32> {
        let going_on =
            (0..batch.len()).filter(|&i| batch[i].sample.next.is_some()).collect::<Vec<_>>();
        let mut next_values = vec![None; batch.len()];
        if !going_on.is_empty() {
            let spaces = going_on
                .iter()
                .map(|&i| self.space(depth_idx, next_centers[i]))
                .collect::<Vec<_>>();
            let (values, voxels) = self.next_values(depth_idx, batch, &going_on, &spaces);
            for (k, &i) in going_on.iter().enumerate() {
                next_values[i] = Some(values[k]);
                next_centers[i] = spaces[k].point_from_voxel(spaces[k].voxel_from_flat(voxels[k]));
            }
        }
        let discount = self.settings.discount;
        batch
            .iter()
            .zip(next_values)
            .map(|(sample, next)| td_target(sample.sample.reward, discount, next))
            .collect()
    }

    /// Double Q: the target network's value of what the online network chooses next, and the voxels
    /// it chooses.
    fn next_values(
        &self,
        depth_idx: usize,
        batch: &[Augmented<'_>],
        going_on: &[usize],
        spaces: &[VoxelSpace],
    ) -> (Vec<f32>, Vec<usize>) {
        let next = |i: usize| batch[i].sample.next.expect("only samples that go on are asked for");
        let grids = going_on
            .iter()
            .zip(spaces)
            .map(|(&i, &space)| batch[i].moved_grid(next(i), space))
            .collect::<Vec<_>>();
        let proprio = going_on.iter().map(|&i| batch[i].moved_proprio(next(i))).collect::<Vec<_>>();
        let depth = &self.depths[depth_idx];
        let input = NetworkInput::new(&depth.online, &grids, &proprio, &self.device);
        let best = Choices::best(&depth.online.forward(input.clone()));
        let values = chosen_values(&depth.target.forward(input), &best).mean_dim(1);
        (floats(values), ints(best.voxel))
    }

    fn space(&self, depth_idx: usize, center: Vec3) -> VoxelSpace {
        self.codec.zoom(depth_idx, center).expect("there is a space for each depth")
    }

    /// The gradients of one depth towards `targets`.
    fn fit(
        &self,
        depth_idx: usize,
        batch: &[Augmented<'_>],
        targets: Vec<f32>,
        n_samples: usize,
    ) -> DepthPart {
        let device = self.device.clone().autodiff();
        let grids = batch.iter().map(|sample| sample.grid(depth_idx)).collect::<Vec<_>>();
        let proprio = batch
            .iter()
            .map(|sample| sample.moved_proprio(sample.sample.observation))
            .collect::<Vec<_>>();
        let leaves = self.depths[depth_idx].online.clone().train();
        let values = leaves.forward(NetworkInput::new(&leaves, &grids, &proprio, &device));
        let choices = labels(depth_idx, batch, values.pose.is_some(), &device);
        let loss_weights = LossWeights {
            translation: self.settings.translation_regularisation[depth_idx],
            rotation: self.settings.rotation_regularisation,
            imitation: self.settings.imitation,
        };
        let weights = batch.iter().map(|sample| sample.sample.weight / n_samples as f32).collect();
        let imitated =
            batch.iter().map(|sample| f32::from(u8::from(sample.sample.imitated))).collect();
        let [targets, weights, imitated] =
            [targets, weights, imitated].map(|column| tensor(column, [batch.len()], &device));
        let loss =
            depth_loss(&values, &choices, PerSample { targets, weights, imitated }, loss_weights);
        let gradients = parameter_gradients(&leaves, loss.total.backward());
        DepthPart { loss: floats(loss.total)[0], huber: floats(loss.huber), gradients }
    }
}

/// The part of some samples in an update.
struct Half {
    /// Of the first depth.
    sum_of_targets: f32,
    depths: Vec<DepthPart>,
}

/// The part of some samples in the update of one depth.
struct DepthPart {
    loss: f32,
    /// One a sample.
    huber: Vec<f32>,
    gradients: ParameterGradients,
}

/// Index of [`Gripper::Open`] among the gripper's values.
const OPEN: usize = 1;

/// The actions of a batch as choices of one depth.
fn labels(depth_idx: usize, batch: &[Augmented<'_>], with_pose: bool, device: &Device) -> Choices {
    let n = batch.len();
    let voxel = batch.iter().map(|sample| sample.depths[depth_idx].flat as i32).collect();
    let pose = with_pose.then(|| {
        let bins = batch.iter().flat_map(|sample| sample.rotation.map(|bin| bin as i32)).collect();
        let command =
            |sample: &Augmented<'_>| i32::from(sample.sample.action.gripper == Gripper::Open);
        (
            indices(bins, [n, 3, 1], device),
            indices(batch.iter().map(command).collect(), [n, 1], device),
        )
    });
    Choices { voxel: indices(voxel, [n, 1], device), pose }
}

/// Adds one depth's part to the priorities: `√(huber + 1e-10)` over the largest of the batch.
///
/// In the released code a depth's priority is added into every later one, and the stack sums them
/// all: the first depth of two counts twice.
fn add_priorities(priorities: &mut [f32], huber: &[f32], times: usize) {
    let sizes = huber.iter().map(|loss| libm::sqrtf(loss + 1e-10)).collect::<Vec<_>>();
    let most = sizes.iter().fold(0.0_f32, |most, size| most.max(*size));
    for (priority, size) in priorities.iter_mut().zip(sizes) {
        *priority += times as f32 * size / most;
    }
}

fn indices<const D: usize>(values: Vec<i32>, shape: [usize; D], device: &Device) -> Tensor<D, Int> {
    Tensor::from_data(TensorData::new(values, shape), device)
}

fn ints<const D: usize>(tensor: Tensor<D, Int>) -> Vec<usize> {
    tensor
        .into_data()
        .iter::<i64>()
        .map(|index| usize::try_from(index).expect("indices are not negative"))
        .collect()
}
