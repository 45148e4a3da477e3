//! The loss of one depth: a double-Q temporal difference with a regulariser on all values.
//!
//! With the reward `r`, the discount `γ` and the value `V'` that the target network gives the
//! online network's choice:
//!
//! ```text
//! y = max(0, r + γ V')                       (y = r when the episode ended)
//! L = mean_batch w (mean_k huber(Q_k(a_k) - y) + λ_t mean|Q_t| + λ_r mean|Q_rg|)
//! ```
//!
//! `k` runs over what a depth chooses: the voxel, and at the last depth also three rotation bins
//! and the gripper. All regress on the same `y`, and `V'` is the mean over them. Huber is quadratic
//! within 1.
//!
//! # Differences from the paper
//!
//! The paper's background writes a plain squared error; double Q, Huber and the regulariser are of
//! the released code.
//!
//! Actions of successful episodes can add `λ_d mean_k -log softmax(Q_k / T)(a_k)` ([`Imitation`];
//! not in the `paper` preset). The loss above gives a voxel that is right with probability `p` the
//! value `1 - λ_t K / (V p)`, so likely and unlikely neighbours hardly differ; this term sets them
//! `T log(p / p')` apart. It is a smooth form of the margin of deep Q-learning from demonstrations
//! (Hester et al. 2018), and the cross-entropy of `PerAct` at `T = 1`. Without it, 160 updates on
//! 10 demonstrations of `take_lid_off_saucepan` bring 1 of 40 grasps within 10 cm and none within 2
//! cm, with it (preset `fast`) 35 and 10 (`examples/qattention_study.rs`).

use super::network::{PoseValues, QValues};
use super::settings::Imitation;

use burn::tensor::activation::log_softmax;
use burn::tensor::{Int, Tensor};

/// The choice of each sample of a batch at one depth.
#[derive(Debug, Clone)]
pub(super) struct Choices {
    /// `[B, 1]`: voxels, flat.
    pub(super) voxel: Tensor<2, Int>,
    /// At the last depth, rotation bins `[B, 3, 1]` and gripper `[B, 1]` (0 close, 1 open).
    pub(super) pose: Option<(Tensor<3, Int>, Tensor<2, Int>)>,
}

impl Choices {
    /// The best of everything: `argmax`.
    pub(super) fn best(values: &QValues) -> Self {
        let pose = values
            .pose
            .as_ref()
            .map(|pose| (pose.rotation.clone().argmax(2), pose.gripper.clone().argmax(1)));
        Self { voxel: values.translation.clone().argmax(1), pose }
    }
}

/// The values of the chosen parts, `[B, K]`: one column for the voxel, at the last depth four more.
pub(super) fn chosen_values(values: &QValues, choices: &Choices) -> Tensor<2> {
    let voxel = values.translation.clone().gather(1, choices.voxel.clone());
    let (Some(PoseValues { rotation, gripper }), Some((bins, command))) =
        (&values.pose, &choices.pose)
    else {
        return voxel;
    };
    let [n, _, _] = rotation.dims();
    let rotation = rotation.clone().gather(2, bins.clone()).reshape([n, 3]);
    Tensor::cat(vec![voxel, rotation, gripper.clone().gather(1, command.clone())], 1)
}

/// Target of the values: `max(0, r + γ V')`, exactly `r` without a next value.
pub(super) fn td_target(reward: f32, discount: f32, next_value: Option<f32>) -> f32 {
    (reward + next_value.map_or(0.0, |value| discount * value)).max(0.0)
}

/// The loss of one depth or its part of some samples, and the mean Huber loss of each sample before
/// weighting.
pub(super) struct DepthLoss {
    /// `[1]`.
    pub(super) total: Tensor<1>,
    /// `[B]`.
    pub(super) huber: Tensor<1>,
}

/// `λ_t`, `λ_r`, and `λ_d` with its `T`.
#[derive(Debug, Clone, Copy)]
pub(super) struct LossWeights {
    pub(super) translation: f32,
    pub(super) rotation: f32,
    pub(super) imitation: Option<Imitation>,
}

/// One number per sample, `[B]` each.
#[derive(Debug, Clone)]
pub(super) struct PerSample {
    /// Targets of the values.
    pub(super) targets: Tensor<1>,
    /// Importance weights over the number of samples of the batch.
    pub(super) weights: Tensor<1>,
    /// 1 for the samples to imitate, else 0.
    pub(super) imitated: Tensor<1>,
    /// Voxels over which the position to imitate is spread; none: its voxel alone.
    pub(super) spread: Option<SpreadLabels>,
}

/// Positions spread over voxels.
#[derive(Debug, Clone)]
pub(super) struct SpreadLabels {
    /// `[B, 8]`: voxels, flat.
    pub(super) voxels: Tensor<2, Int>,
    /// `[B, 8]`: their weights, which sum to 1.
    pub(super) weights: Tensor<2>,
}

/// The loss of one depth; of some samples of a batch, their part of it.
pub(super) fn depth_loss(
    values: &QValues,
    choices: &Choices,
    samples: PerSample,
    loss_weights: LossWeights,
) -> DepthLoss {
    let chosen = chosen_values(values, choices);
    let [n, n_parts] = chosen.dims();
    let errors = (chosen - samples.targets.reshape([n, 1]).expand([n, n_parts])).abs();
    let huber = huber(errors).mean_dim(1).reshape([n]);
    let mut per_sample =
        huber.clone() + mean_size(values.translation.clone()) * loss_weights.translation;
    if let Some(pose) = &values.pose {
        let [_, _, bins] = pose.rotation.dims();
        let all = Tensor::cat(
            vec![pose.rotation.clone().reshape([n, 3 * bins]), pose.gripper.clone()],
            1,
        );
        per_sample = per_sample + mean_size(all) * loss_weights.rotation;
    }
    if let Some(Imitation { weight, temperature }) = loss_weights.imitation {
        per_sample = per_sample
            + surprise(values, choices, samples.spread, temperature) * samples.imitated * weight;
    }
    DepthLoss { total: (per_sample * samples.weights).sum(), huber }
}

/// Mean over the parts of `-log softmax(Q / T)` at the choices: `[B]`.
fn surprise(
    values: &QValues,
    choices: &Choices,
    spread: Option<SpreadLabels>,
    temperature: f32,
) -> Tensor<1> {
    let log_odds = QValues {
        translation: log_softmax(values.translation.clone() / temperature, 1),
        pose: values.pose.as_ref().map(|pose| PoseValues {
            rotation: log_softmax(pose.rotation.clone() / temperature, 2),
            gripper: log_softmax(pose.gripper.clone() / temperature, 1),
        }),
    };
    let chosen = chosen_values(&log_odds, choices);
    let [n, n_parts] = chosen.dims();
    let Some(SpreadLabels { voxels, weights }) = spread else {
        return chosen.mean_dim(1).reshape([n]).neg();
    };
    // In place of the voxel's column, the first.
    let position = (log_odds.translation.gather(1, voxels) * weights).sum_dim(1);
    let voxel = chosen.clone().slice([0..n, 0..1]);
    ((chosen.sum_dim(1) - voxel + position) / n_parts as f32).reshape([n]).neg()
}

/// `e² / 2` within 1, `|e| - 1 / 2` beyond, of absolute errors.
fn huber(errors: Tensor<2>) -> Tensor<2> {
    let near = errors.clone().clamp_max(1.0);
    // |e| min(|e|, 1) - min(|e|, 1)² / 2 is both branches at once.
    errors * near.clone() - near.square() * 0.5
}

/// Mean absolute value of each row: `[B, N]` to `[B]`.
fn mean_size(values: Tensor<2>) -> Tensor<1> {
    let [n, _] = values.dims();
    values.abs().mean_dim(1).reshape([n])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::nn::{Backend, tensor, values as read};

    use burn::tensor::{Device, TensorData};

    fn values(device: &Device) -> QValues {
        QValues {
            translation: tensor(vec![0.1, 0.9, -0.4, 0.0, 2.5, 0.3, 0.2, 0.1], [2, 4], device),
            pose: Some(PoseValues {
                rotation: tensor(
                    (0..12).map(|i| i as f32 * 0.1 - 0.3).collect(),
                    [2, 3, 2],
                    device,
                ),
                gripper: tensor(vec![0.5, 0.25, -1.5, 0.0], [2, 2], device),
            }),
        }
    }

    #[test]
    fn targets_are_rewards_at_the_end_and_never_negative() {
        assert_eq!(td_target(1.0, 0.99, None), 1.0);
        assert_eq!(td_target(0.0, 0.99, None), 0.0);
        assert_eq!(td_target(0.0, 0.5, Some(0.8)), 0.4);
        assert_eq!(td_target(0.25, 0.5, Some(1.0)), 0.75);
        assert_eq!(td_target(0.0, 0.99, Some(-0.3)), 0.0);
    }

    #[test]
    fn the_value_of_a_choice_is_read_per_part() {
        let device = Backend::Flex.device();
        let values = values(&device);
        let best = Choices::best(&values);
        let found = read(chosen_values(&values, &best));
        let expected = [0.9, -0.2, 0.0, 0.2, 0.5, 2.5, 0.4, 0.6, 0.8, 0.0];
        assert_eq!(found.len(), expected.len());
        assert!(
            found
                .iter()
                .zip(expected)
                .all(|(found, expected): (&f32, f32)| (found - expected).abs() < 1e-6),
            "{found:?}"
        );
    }

    #[test]
    fn the_loss_is_what_the_formula_says() {
        let device = Backend::Flex.device();
        let values = values(&device);
        let best = Choices::best(&values);
        let loss_weights = LossWeights { translation: 0.5, rotation: 0.25, imitation: None };
        let loss = depth_loss(
            &values,
            &best,
            PerSample {
                targets: tensor(vec![1.0, 0.0], [2], &device),
                weights: tensor(vec![0.5, 0.25], [2], &device),
                imitated: tensor(vec![1.0; 2], [2], &device),
                spread: None,
            },
            loss_weights,
        );
        // Sample 0 against y = 1: errors 0.1, 1.2, 1, 0.8, 0.5. Sample 1 against y = 0: 2.5, 0.4,
        // 0.6, 0.8, 0.
        let huber = [(0.005 + 0.7 + 0.5 + 0.32 + 0.125) / 5.0, (2.0 + 0.08 + 0.18 + 0.32) / 5.0];
        for (found, expected) in read(loss.huber).iter().zip(huber) {
            assert!((found - expected).abs() < 1e-6, "{found} for {expected}");
        }
        let translation = [1.4 / 4.0, 3.1 / 4.0];
        let pose = [
            (0.3 + 0.2 + 0.1 + 0.0 + 0.1 + 0.2 + 0.75) / 8.0,
            (0.3 + 0.4 + 0.5 + 0.6 + 0.7 + 0.8 + 1.5) / 8.0,
        ];
        let sample = |i: usize| huber[i] + 0.5 * translation[i] + 0.25 * pose[i];
        let expected = (sample(0) + 0.5 * sample(1)) / 2.0;
        let found = read(loss.total)[0];
        assert!((found - expected).abs() < 1e-6, "{found} for {expected}");
    }

    #[test]
    fn regression_gradients_are_bounded_by_one_over_the_parts() {
        let device = Backend::Flex.device().autodiff();
        let translation = tensor(vec![3.0, 0.5, -2.0, 0.2], [1, 4], &device).require_grad();
        let values = QValues { translation: translation.clone(), pose: None };
        let voxel = Tensor::from_data(TensorData::new(vec![0_i32], [1, 1]), &device);
        let loss_weights = LossWeights { translation: 0.4, rotation: 0.0, imitation: None };
        let one = tensor(vec![1.0], [1], &device);
        let loss = depth_loss(
            &values,
            &Choices { voxel, pose: None },
            PerSample { targets: one.clone(), weights: one.clone(), imitated: one, spread: None },
            loss_weights,
        );
        let gradient =
            read(translation.grad(&loss.total.backward()).expect("the loss depends on it"));
        // Huber beyond 1 has slope 1 on the chosen voxel; |Q| has slope ±0.1 on all.
        for (found, expected) in gradient.iter().zip([1.1, 0.1, -0.1, 0.1]) {
            assert!((found - expected).abs() < 1e-6, "{gradient:?}");
        }
    }

    #[test]
    fn imitation_is_the_cross_entropy_of_the_choices_of_imitated_samples() {
        let device = Backend::Flex.device();
        let translation = tensor(vec![0.5, 0.0, 0.2, 0.2], [2, 2], &device);
        let values = QValues { translation, pose: None };
        let voxel = Tensor::from_data(TensorData::new(vec![0_i32, 1], [2, 1]), &device);
        let chosen = tensor(vec![0.5, 0.2], [2], &device);
        let rows = PerSample {
            targets: chosen,
            weights: tensor(vec![0.5; 2], [2], &device),
            imitated: tensor(vec![1.0, 0.0], [2], &device),
            spread: None,
        };
        let loss_weights = LossWeights {
            translation: 0.0,
            rotation: 0.0,
            imitation: Some(Imitation { weight: 2.0, temperature: 0.25 }),
        };
        let loss = depth_loss(&values, &Choices { voxel, pose: None }, rows, loss_weights);
        // Log odds 2 and 0: -log(1 / (1 + e^-2)), on one of two samples, times 2.
        let expected = (1.0 + (-2.0_f32).exp()).ln();
        let found = read(loss.total)[0];
        assert!((found - expected).abs() < 1e-6, "{found} for {expected}");
    }

    #[test]
    fn a_spread_position_takes_the_place_of_its_voxel_among_the_parts() {
        let device = Backend::Flex.device();
        let values = values(&device);
        let best = Choices::best(&values);
        let voxels = Tensor::from_data(TensorData::new(vec![0_i32, 1, 0, 3], [2, 2]), &device);
        let weights = tensor(vec![0.25, 0.75, 1.0, 0.0], [2, 2], &device);
        let spread = SpreadLabels { voxels, weights };
        let [alone, spread] =
            [None, Some(spread)].map(|spread| read(surprise(&values, &best, spread, 0.5)));
        let odds = read(log_softmax(values.translation / 0.5, 1));
        // Sample 0 has its best voxel at 1, sample 1 at 0.
        for (sample, (own, expected)) in
            [(odds[1], 0.25 * odds[0] + 0.75 * odds[1]), (odds[4], odds[4])].iter().enumerate()
        {
            let change = -(expected - own) / 5.0;
            assert!((spread[sample] - alone[sample] - change).abs() < 1e-6);
        }
        assert!(spread[0] > alone[0] + 1e-2);
    }
}
