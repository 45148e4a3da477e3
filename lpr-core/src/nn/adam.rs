//! Adam on the named parameter vectors of a network, with L2 regularisation and gradient clipping
//! as in `PyTorch`.
//!
//! burn's optimiser keeps its state under parameter ids that are drawn at random; here it is two
//! vectors per parameter and a count, in the order of the network's fields, which a checkpoint
//! stores and restores bit by bit. It also needs one pass over each parameter instead of one per
//! operation.

use super::halves::ParameterGradients;
use super::parameters::{NamedTensor, export, find, map_values};
use super::values::values;
use crate::check::setting;
use crate::error::{Error, Result};

use burn::module::{Module, ModuleVisitor, Param};
use burn::tensor::{Gradients, Tensor};
use serde::{Deserialize, Serialize};

/// Decay of the mean of the gradients: `PyTorch`'s default, which the released code keeps.
const BETA_1: f64 = 0.9;
/// Decay of the mean of the squared gradients: `PyTorch`'s default.
const BETA_2: f64 = 0.999;
/// Keeps the division finite: `PyTorch`'s default.
const EPSILON: f32 = 1e-8;

/// Settings of the step from gradients to an update.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct AdamSettings {
    /// Step size: `λ` in the paper.
    pub learning_rate: f32,
    /// Weight of the L2 regularisation, added to the gradients after clipping.
    pub l2: f32,
    /// Limit of the gradients.
    pub clip: GradientClip,
}

impl AdamSettings {
    /// Checks the ranges of all numbers.
    ///
    /// # Errors
    ///
    /// [`Error::Config`] naming the first setting that is negative or not finite.
    pub fn check(&self) -> Result<()> {
        let limit = match self.clip {
            GradientClip::None => 0.0,
            GradientClip::Value(limit) | GradientClip::Norm(limit) => limit,
        };
        for (name, number) in
            [("adam.learning_rate", self.learning_rate), ("adam.l2", self.l2), ("adam.clip", limit)]
        {
            let holds = number.is_finite() && number >= 0.0;
            setting(holds, name, "a finite number from 0", number)?;
        }
        Ok(())
    }
}

/// Limit of the gradients of one update.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum GradientClip {
    /// No limit.
    None,
    /// Each number is clamped to `±limit`.
    Value(f32),
    /// All are scaled so that their Euclidean norm is at most the limit.
    Norm(f32),
}

/// Memory of Adam: part of a checkpoint.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct AdamState {
    /// Updates so far.
    pub updates: u64,
    /// Running mean of the gradients of each parameter.
    pub first: Vec<NamedTensor>,
    /// Running mean of the squared gradients of each parameter.
    pub second: Vec<NamedTensor>,
}

/// Adam for one network.
#[derive(Debug, Clone)]
pub(crate) struct Adam {
    settings: AdamSettings,
    state: AdamState,
}

impl Adam {
    /// Adam that has made no update of `module` yet.
    pub(crate) fn new<M: Module>(settings: AdamSettings, module: &M) -> Self {
        let mut zeros = export(module);
        zeros.iter_mut().for_each(|tensor| tensor.values.fill(0.0));
        Self { settings, state: AdamState { updates: 0, first: zeros.clone(), second: zeros } }
    }

    /// `module` after one update.
    pub(crate) fn step<M: Module>(&mut self, module: M, mut gradients: ParameterGradients) -> M {
        clip(&mut gradients, self.settings.clip);
        self.state.updates += 1;
        let rate = StepSize::new(self.settings.learning_rate, self.state.updates);
        map_values(module, |idx, mut parameter| {
            let (first, second) =
                (&mut self.state.first[idx].values, &mut self.state.second[idx].values);
            let numbers = parameter.iter_mut().zip(&gradients[idx]).zip(first).zip(second);
            for (((p, gradient), first), second) in numbers {
                let gradient = gradient + self.settings.l2 * *p;
                *first = BETA_1 as f32 * *first + (1.0 - BETA_1) as f32 * gradient;
                *second = BETA_2 as f32 * *second + (1.0 - BETA_2) as f32 * gradient * gradient;
                *p -= rate.first * *first / (second.sqrt() * rate.second + EPSILON);
            }
            parameter
        })
    }

    /// Its memory.
    pub(crate) const fn state(&self) -> &AdamState {
        &self.state
    }

    /// Goes on from `state`, which must be of a network with the same parameters.
    pub(crate) fn restore(&mut self, state: &AdamState) -> Result<()> {
        let fit = |own: &[NamedTensor], other: &[NamedTensor]| -> Result<Vec<NamedTensor>> {
            if own.len() != other.len() {
                return Err(Error::Checkpoint(format!(
                    "expected {} optimiser tensors, found {}",
                    own.len(),
                    other.len()
                )));
            }
            own.iter().map(|tensor| find(tensor, other).cloned()).collect()
        };
        let first = fit(&self.state.first, &state.first)?;
        let second = fit(&self.state.second, &state.second)?;
        self.state = AdamState { updates: state.updates, first, second };
        Ok(())
    }
}

/// Factors of one update that correct the means for having started at zero.
struct StepSize {
    /// `λ / (1 - β₁ᵗ)`.
    first: f32,
    /// `1 / √(1 - β₂ᵗ)`.
    second: f32,
}

impl StepSize {
    fn new(learning_rate: f32, updates: u64) -> Self {
        let t = updates as f64;
        let first = f64::from(learning_rate) / (1.0 - libm::pow(BETA_1, t));
        let second = 1.0 / libm::sqrt(1.0 - libm::pow(BETA_2, t));
        Self { first: first as f32, second: second as f32 }
    }
}

fn clip(gradients: &mut [Vec<f32>], limit: GradientClip) {
    let all = gradients.iter_mut().flatten();
    match limit {
        GradientClip::None => {}
        GradientClip::Value(limit) => all.for_each(|g| *g = g.clamp(-limit, limit)),
        GradientClip::Norm(limit) => {
            let norm =
                libm::sqrt(gradients.iter().flatten().map(|&g| f64::from(g) * f64::from(g)).sum());
            // 1e-6: as PyTorch's `clip_grad_norm_`.
            let scale = (f64::from(limit) / (norm + 1e-6)).min(1.0) as f32;
            gradients.iter_mut().flatten().for_each(|g| *g *= scale);
        }
    }
}

/// The gradients of all parameters of `leaves`, which is a network's `train()`, whose parameters the
/// loss of `gradients` was computed from.
pub(crate) fn parameter_gradients<M: Module>(
    leaves: &M,
    gradients: Gradients,
) -> ParameterGradients {
    let mut collector = Collector { gradients, collected: Vec::new() };
    leaves.visit(&mut collector);
    collector.collected
}

struct Collector {
    gradients: Gradients,
    collected: ParameterGradients,
}

impl ModuleVisitor for Collector {
    fn visit_float<const D: usize>(&mut self, param: &Param<Tensor<D>>) {
        let leaf = param.val();
        let n_values = leaf.dims().iter().product();
        // A parameter that the loss does not depend on has no gradient.
        self.collected.push(
            leaf.grad_remove(&mut self.gradients).map_or_else(|| vec![0.0; n_values], values),
        );
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::nn::{Backend, Mlp, Spread, tensor};
    use crate::rng::{Stream, stream};

    const SETTINGS: AdamSettings =
        AdamSettings { learning_rate: 0.01, l2: 1e-3, clip: GradientClip::None };

    fn network() -> Mlp {
        Mlp::new(
            &[2, 8, 1],
            Spread::Xavier,
            &Backend::Flex.device(),
            &mut stream(3, Stream::Init, 0),
        )
    }

    /// One update towards the sum of two inputs; the loss before it.
    fn update(network: &mut Mlp, adam: &mut Adam) -> f32 {
        let device = Backend::Flex.device().autodiff();
        let leaves = network.clone().train();
        let x = tensor(vec![0.1, 0.2, -0.3, 0.9, 0.5, -0.7], [3, 2], &device);
        let y = tensor(vec![0.3, 0.6, -0.2], [3, 1], &device);
        let loss = (leaves.forward(x) - y).square().mean();
        let gradients = parameter_gradients(&leaves, loss.backward());
        *network = adam.step(network.clone(), gradients);
        loss.into_scalar()
    }

    #[test]
    fn settings_out_of_range_are_named() {
        let good = AdamSettings { learning_rate: 1e-3, l2: 0.0, clip: GradientClip::Norm(1.0) };
        assert_eq!(good.check(), Ok(()));
        for (bad, name) in [
            (AdamSettings { learning_rate: f32::NAN, ..good }, "adam.learning_rate"),
            (AdamSettings { l2: -1.0, ..good }, "adam.l2"),
            (AdamSettings { clip: GradientClip::Value(f32::INFINITY), ..good }, "adam.clip"),
        ] {
            let message = bad.check().expect_err(name).to_string();
            assert!(message.contains(&format!("{name}: expected")), "{message}");
        }
    }

    #[test]
    fn a_restored_optimiser_goes_on_bit_by_bit() {
        let mut straight = network();
        let mut adam = Adam::new(SETTINGS, &straight);
        let before = update(&mut straight, &mut adam);
        let (mut resumed, state) = (straight.clone(), adam.state().clone());
        let mut fresh = Adam::new(SETTINGS, &network());
        fresh.restore(&state).expect("the same network");
        let mut after = before;
        for _ in 0..20 {
            after = update(&mut straight, &mut adam);
            assert_eq!(after.to_bits(), update(&mut resumed, &mut fresh).to_bits());
        }
        assert_eq!(export(&straight), export(&resumed));
        assert!(after < 0.5 * before, "the loss fell from {before} only to {after}");
    }

    #[test]
    fn a_state_of_another_network_is_refused() {
        let other = Mlp::new(
            &[2, 9, 1],
            Spread::Xavier,
            &Backend::Flex.device(),
            &mut stream(3, Stream::Init, 0),
        );
        let mut adam = Adam::new(SETTINGS, &network());
        let error = adam.restore(Adam::new(SETTINGS, &other).state()).expect_err("another width");
        assert!(error.to_string().contains("layers.0.weight"), "{error}");
    }

    #[test]
    fn clipping_limits_values_or_the_norm() {
        let gradients = || vec![vec![3.0, -0.1], vec![-4.0]];
        let clipped = |limit| {
            let mut all = gradients();
            clip(&mut all, limit);
            all
        };
        assert_eq!(clipped(GradientClip::None), gradients());
        assert_eq!(clipped(GradientClip::Value(0.5)), [vec![0.5, -0.1], vec![-0.5]]);
        let norm =
            clipped(GradientClip::Norm(1.0)).iter().flatten().map(|g| g * g).sum::<f32>().sqrt();
        assert!((norm - 1.0).abs() < 1e-5, "{norm}");
        assert_eq!(clipped(GradientClip::Norm(1e3)), gradients());
    }
}
