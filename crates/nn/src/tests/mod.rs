//! Tests of the operations and layers.

mod bits;
mod cases;
mod gradients;
mod hard_cases;
mod layers;

use atsplat_numeric::SplitMix64;
use burn::Tensor;
use burn::tensor::{DType, Device, TensorData};

/// Values in [−1, 1), the same on every machine.
fn uniform(count: usize, seed: u64) -> Vec<f64> {
    let mut random = SplitMix64::new(seed);
    (0..count).map(|_| f64::from(2.0 * random.unit_f32() - 1.0)).collect()
}

fn tensor<const D: usize>(values: &[f64], shape: [usize; D], dtype: DType, device: &Device) -> Tensor<D> {
    Tensor::from_data(TensorData::new(values.to_vec(), shape), (device, dtype))
}

fn random<const D: usize>(shape: [usize; D], seed: u64) -> Tensor<D> {
    tensor(&uniform(shape.iter().product(), seed), shape, DType::F32, &Device::flex())
}

fn values<const D: usize>(tensor: Tensor<D>) -> Vec<f64> {
    tensor.into_data_as::<f64>().try_to_vec().unwrap()
}

fn bits<const D: usize>(tensor: Tensor<D>) -> Vec<u32> {
    tensor.into_data().try_to_vec::<f32>().unwrap().into_iter().map(f32::to_bits).collect()
}
