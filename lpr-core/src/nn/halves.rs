//! Batches in two halves, each on a thread where there are two.
//!
//! The halves and the order in which their gradients are added do not depend on the number of
//! threads, so that one and two give the same bits.

use crate::in_order::map_in_order;

/// Gradients of all parameters in the order of a network's fields.
pub(crate) type ParameterGradients = Vec<Vec<f32>>;

/// `f` of each half of `batch`; of all of it where that is one sample.
pub(crate) fn in_halves<T: Sync, R: Send>(
    batch: &[T],
    f: impl Fn(&[T]) -> R + Sync + Send,
) -> Vec<R> {
    let halves = batch.chunks(batch.len().div_ceil(2).max(1)).collect::<Vec<_>>();
    map_in_order(halves.len(), |half| f(halves[half]))
}

/// The sum of the gradients of all parts, in their order.
pub(crate) fn sum_of_gradients(
    parts: impl IntoIterator<Item = ParameterGradients>,
) -> ParameterGradients {
    let mut parts = parts.into_iter();
    let mut sums = parts.next().unwrap_or_default();
    for part in parts {
        for (sum, value) in sums.iter_mut().flatten().zip(part.iter().flatten()) {
            *sum += value;
        }
    }
    sums
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_sample_is_in_one_half() {
        for n in [1, 2, 3, 16, 17] {
            let batch = (0..n).collect::<Vec<_>>();
            let halves = in_halves(&batch, <[usize]>::to_vec);
            assert_eq!(halves.len(), n.min(2));
            assert_eq!(halves.concat(), batch);
        }
    }

    #[test]
    fn gradients_are_added_parameter_by_parameter() {
        let parts = [vec![vec![1.0, 2.0], vec![3.0]], vec![vec![10.0, 20.0], vec![30.0]]];
        assert_eq!(sum_of_gradients(parts), [vec![11.0, 22.0], vec![33.0]]);
    }
}
