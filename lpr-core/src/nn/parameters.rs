//! Parameters of a network as named vectors: what checkpoints hold, and what target networks mix.

use super::values::{tensor, values};
use crate::error::{Error, Result};

use burn::module::{Module, ModuleMapper, ModuleVisitor, Param};
use burn::tensor::Tensor;
use serde::{Deserialize, Serialize};

/// One parameter tensor: its place in the network, its shape and its values in row-major order.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct NamedTensor {
    /// Path of fields from the network, joined by dots: `encoder.layers.0.weight`.
    pub name: String,
    /// Size along each axis. Weights of fully connected layers are `[inputs, outputs]`.
    pub shape: Vec<usize>,
    /// Values in row-major order.
    pub values: Vec<f32>,
}

/// All parameters in the order of the fields.
pub(crate) fn export<M: Module>(module: &M) -> Vec<NamedTensor> {
    let mut exporter = Exporter { path: Vec::new(), tensors: Vec::new() };
    module.visit(&mut exporter);
    exporter.tensors
}

struct Exporter {
    path: Vec<String>,
    tensors: Vec<NamedTensor>,
}

impl ModuleVisitor for Exporter {
    fn enter_module(&mut self, name: &str, _container_type: &str) {
        self.path.push(name.to_owned());
    }

    fn exit_module(&mut self, _name: &str, _container_type: &str) {
        self.path.pop();
    }

    fn visit_float<const D: usize>(&mut self, param: &Param<Tensor<D>>) {
        let tensor = param.val();
        let shape = tensor.dims().to_vec();
        self.tensors.push(NamedTensor { name: self.path.join("."), shape, values: values(tensor) });
    }
}

/// `module` with the values of `tensors`, which must be those of a network of the same settings in
/// any order.
pub(crate) fn import<M: Module>(module: M, tensors: &[NamedTensor]) -> Result<M> {
    let ordered =
        export(&module).iter().map(|own| find(own, tensors)).collect::<Result<Vec<_>>>()?;
    if ordered.len() != tensors.len() {
        return Err(Error::Checkpoint(format!(
            "the network has {} tensors, the checkpoint {}",
            ordered.len(),
            tensors.len()
        )));
    }
    Ok(map_values(module, |idx, _| ordered[idx].values.clone()))
}

/// The tensor of the checkpoint that fits `own`.
pub(super) fn find<'a>(own: &NamedTensor, tensors: &'a [NamedTensor]) -> Result<&'a NamedTensor> {
    let Some(found) = tensors.iter().find(|tensor| tensor.name == own.name) else {
        return Err(Error::Checkpoint(format!("no tensor `{}`", own.name)));
    };
    if found.shape != own.shape || found.values.len() != own.values.len() {
        return Err(Error::Checkpoint(format!(
            "tensor `{}`: expected shape {:?}, found {:?} with {} values",
            own.name,
            own.shape,
            found.shape,
            found.values.len()
        )));
    }
    if let Some(value) = found.values.iter().find(|value| !value.is_finite()) {
        return Err(Error::Checkpoint(format!("tensor `{}` holds {value}", own.name)));
    }
    Ok(found)
}

/// One step of a target network towards the online one: `θ' ← τ θ + (1 - τ) θ'` (Algorithm 1).
pub(crate) fn mix<M: Module>(target: M, online: &M, tau: f32) -> M {
    let online = export(online);
    map_values(target, |idx, mut target| {
        for (target, online) in target.iter_mut().zip(&online[idx].values) {
            *target = tau * online + (1.0 - tau) * *target;
        }
        target
    })
}

/// `module` with every parameter replaced by `change(index of the parameter, its values)`, on the
/// same device.
pub(super) fn map_values<M: Module>(
    module: M,
    change: impl FnMut(usize, Vec<f32>) -> Vec<f32>,
) -> M {
    module.map(&mut ValueMapper { next: 0, change })
}

struct ValueMapper<F> {
    next: usize,
    change: F,
}

impl<F: FnMut(usize, Vec<f32>) -> Vec<f32>> ModuleMapper for ValueMapper<F> {
    fn map_float<const D: usize>(&mut self, param: Param<Tensor<D>>) -> Param<Tensor<D>> {
        let (id, old, mapper) = param.consume();
        let (shape, device) = (old.dims(), old.device());
        let new = (self.change)(self.next, values(old));
        self.next += 1;
        Param::from_mapped_value(id, tensor(new, shape, &device), mapper)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::nn::{Backend, Mlp, Spread};
    use crate::rng::{Stream, stream};

    fn network(seed: u64) -> Mlp {
        Mlp::new(
            &[3, 4, 2],
            Spread::Xavier,
            &Backend::Flex.device(),
            &mut stream(seed, Stream::Init, 0),
        )
    }

    #[test]
    fn import_is_the_inverse_of_export_in_any_order() {
        let mut tensors = export(&network(1));
        let names: Vec<_> = tensors.iter().map(|tensor| tensor.name.as_str()).collect();
        assert_eq!(names, ["layers.0.weight", "layers.0.bias", "layers.1.weight", "layers.1.bias"]);
        assert_eq!(tensors[0].shape, [3, 4]);
        let expected = tensors.clone();
        tensors.reverse();
        let copy = import(network(2), &tensors).expect("the same sizes");
        assert_eq!(export(&copy), expected);
    }

    #[test]
    fn a_foreign_checkpoint_is_an_error_that_names_the_tensor() {
        let broken = |change: fn(&mut Vec<NamedTensor>)| {
            let mut tensors = export(&network(1));
            change(&mut tensors);
            import(network(1), &tensors).expect_err("a broken checkpoint").to_string()
        };
        assert!(broken(|tensors| tensors[0].shape.reverse()).contains("layers.0.weight"));
        assert!(broken(|tensors| tensors[1].values[0] = f32::NAN).contains("NaN"));
        assert!(
            broken(|tensors| "other".clone_into(&mut tensors[2].name)).contains("layers.1.weight")
        );
        assert!(broken(|tensors| tensors.push(tensors[0].clone())).contains("5"));
        assert!(broken(|tensors| tensors.truncate(3)).contains("layers.1.bias"));
    }

    #[test]
    fn mixing_by_one_copies_and_by_a_quarter_moves_a_quarter() {
        let (target, online) = (network(1), network(2));
        assert_eq!(export(&mix(target.clone(), &online, 1.0)), export(&online));
        let mixed = export(&mix(target.clone(), &online, 0.25));
        for ((mixed, target), online) in mixed.iter().zip(export(&target)).zip(export(&online)) {
            for ((m, t), o) in mixed.values.iter().zip(target.values).zip(online.values) {
                assert!((m - (t + 0.25 * (o - t))).abs() < 1e-6);
            }
        }
    }
}
