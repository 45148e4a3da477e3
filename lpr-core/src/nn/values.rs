//! Tensors from numbers and back.

use burn::tensor::{Device, Int, Tensor, TensorData};

/// A tensor of `shape` from its values in row-major order.
pub(crate) fn tensor<const D: usize>(
    values: Vec<f32>,
    shape: [usize; D],
    device: &Device,
) -> Tensor<D> {
    Tensor::from_data(TensorData::new(values, shape), device)
}

/// The values of a tensor in row-major order.
pub(crate) fn values<const D: usize>(tensor: Tensor<D>) -> Vec<f32> {
    tensor.into_data().try_into_vec().expect("every float tensor of this crate holds f32")
}

/// Row-major indices of a tensor.
pub(crate) fn ints<const D: usize>(tensor: Tensor<D, Int>) -> Vec<usize> {
    tensor
        .into_data()
        .iter::<i64>()
        .map(|index| usize::try_from(index).expect("indices are not negative"))
        .collect()
}
