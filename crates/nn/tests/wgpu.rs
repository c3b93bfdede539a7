//! Every operation with its gradients on a GPU, against burn's own operations in f64 on the CPU.
//!
//! Without an adapter the test prints a message and passes; with `ATSPLAT_REQUIRE_GPU=1` it fails.

#![expect(clippy::unwrap_used, clippy::indexing_slicing, reason = "helpers of tests fail like tests")]

#[path = "../src/tests/cases.rs"]
mod cases;

use atsplat_nn::{NormKind, ops};
use atsplat_numeric::Tolerance;
use atsplat_tests::skip_without_graphics;
use burn::Tensor;
use burn::tensor::{DType, Device, TensorData};

use cases::{Function, all};

/// f32 against f64, on values of order one with sums of up to a few hundred terms.
const SINGLE: Tolerance = Tolerance { absolute: 2e-5, relative: 2e-5 };

#[test]
fn every_operation_and_its_gradients_on_wgpu() {
    let device = match Device::wgpu_options().init() {
        Ok(device) => device.autodiff(),
        Err(error) => {
            skip_without_graphics("every_operation_and_its_gradients_on_wgpu", error);
            return;
        }
    };
    for case in all() {
        let expected = differentiated(case.burns, &case.inputs, &Device::flex().autodiff(), DType::F64);
        let found = differentiated(case.ours, &case.inputs, &device, DType::F32);
        for (at, (found, expected)) in found.into_iter().zip(expected).enumerate() {
            SINGLE.assert(found, expected, &format!("{}, result and gradients, number {at}", case.name));
        }
    }
}

/// The result, and the gradients of a fixed weighted sum of it by each input.
fn differentiated(operation: Function, sizes: &[usize], device: &Device, dtype: DType) -> Vec<Vec<f64>> {
    let tensor = |values: Vec<f64>| {
        let count = values.len();
        Tensor::<1>::from_data(TensorData::new(values, [count]), (device, dtype))
    };
    let inputs = sizes.iter().zip(1..);
    let inputs: Vec<Tensor<1>> = inputs.map(|(&count, seed)| tensor(uniform(count, seed)).require_grad()).collect();
    let out = operation(&inputs);
    let gradients = (out.clone() * tensor(uniform(out.dims()[0], 99))).sum().backward();
    let values = |tensor: Tensor<1>| tensor.into_data_as::<f64>().try_to_vec().unwrap();
    let mut all = vec![values(out)];
    all.extend(inputs.iter().map(|input| values(input.grad(&gradients).unwrap())));
    all
}

/// Values in [−1, 1) that f32 can hold.
fn uniform(count: usize, seed: u64) -> Vec<f64> {
    let mut state = seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) | 1;
    let mut next = || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 40) as f64 / f64::from(1 << 23) - 1.0
    };
    (0..count).map(|_| next()).collect()
}
