//! One update: the losses of all depths on a batch, and the step down their gradients.

use super::super::batch::{Augmented, AugmentedLabel, QSample};
use super::super::loss::{
    Choices, LossWeights, PerSample, SpreadLabels, chosen_values, depth_loss, td_target,
};
use super::super::network::{ArmInput, DepthInput, NetworkInput};
use super::super::next_best_pose::NextBestPose;
use super::super::observation::QObservation;
use super::super::position::{SURROUNDING, surrounding};
use super::super::settings::Position;
use super::{Depth, QAttention};
use crate::in_order::each_with_scratch;
use crate::nn::{
    ParameterGradients, in_halves, ints, mix, parameter_gradients, sum_of_gradients, tensor,
    values as floats,
};
use crate::perception::VoxelSpace;
use crate::rng::Rng;
use crate::robot::Gripper;

use burn::module::Module as _;
use burn::tensor::{Device, Int, Tensor, TensorData};
use glamx::Vec3;

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
        let samples = going_on
            .iter()
            .zip(spaces)
            .map(|(&i, &space)| self.input(depth_idx, &batch[i], next(i), space))
            .collect::<Vec<_>>();
        let depth = &self.depths[depth_idx];
        let input = NetworkInput::new(&depth.online, &samples, &self.device);
        let best = Choices::best(&depth.online.forward(input.clone()));
        let voxels = ints(best.voxel.clone());
        let input = input.attending(voxels.clone());
        let values = chosen_values(&depth.target.forward(input), &best).mean_dim(1);
        (floats(values), voxels)
    }

    /// What a depth sees in `space` of a moved observation.
    fn input(
        &self,
        depth_idx: usize,
        sample: &Augmented<'_>,
        observation: &QObservation,
        space: VoxelSpace,
    ) -> DepthInput {
        let grid = |space| sample.moved_grid(observation, space);
        let (proprio, jitter) =
            (sample.moved_proprio(observation), sample.hand_jitter(observation));
        self.seen(
            depth_idx,
            space,
            grid,
            ArmInput::new(&self.settings, depth_idx, &proprio, jitter),
        )
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
        let samples = batch
            .iter()
            .map(|sample| {
                let space = sample.depths[depth_idx].space;
                self.input(depth_idx, sample, sample.sample.observation, space)
            })
            .collect::<Vec<_>>();
        let leaves = self.depths[depth_idx].online.clone().train();
        let voxels = batch.iter().map(|sample| sample.depths[depth_idx].flat).collect();
        let input = NetworkInput::new(&leaves, &samples, &device).attending(voxels);
        let values = leaves.forward(input);
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
        let is_last = depth_idx + 1 == self.depths.len();
        let spread = (is_last && self.settings.position == Position::Interpolated)
            .then(|| spread_labels(depth_idx, batch, &device));
        let samples = PerSample { targets, weights, imitated, spread };
        let loss = depth_loss(&values, &choices, samples, loss_weights);
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

/// The positions of a batch, spread over the voxels around them.
fn spread_labels(depth_idx: usize, batch: &[Augmented<'_>], device: &Device) -> SpreadLabels {
    let shape = [batch.len(), SURROUNDING];
    let (voxels, weights): (Vec<_>, Vec<_>) = batch
        .iter()
        .flat_map(|sample| surrounding(&sample.depths[depth_idx].space, sample.point))
        .map(|(flat, weight)| (flat as i32, weight))
        .unzip();
    SpreadLabels { voxels: indices(voxels, shape, device), weights: tensor(weights, shape, device) }
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
