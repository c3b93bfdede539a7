//! Every operation with its gradients on a GPU, against burn's own operations in f64 on the CPU.
//!
//! Without an adapter the test prints a message and passes; with `ATSPLAT_REQUIRE_GPU=1` it fails.

#![expect(clippy::unwrap_used, clippy::indexing_slicing, reason = "helpers of tests fail like tests")]

#[path = "../src/tests/cases.rs"]
mod cases;

use std::sync::LazyLock;

use atsplat_nn::{MatmulPrecision, NormKind, ops};
use atsplat_numeric::{SplitMix64, Tolerance};
use atsplat_tests::{skip, skip_without_graphics};
use burn::Tensor;
use burn::tensor::{DType, Device, FloatDType, TensorData};

use cases::{Function, all};

/// f32 against f64, on values of order one with sums of up to a few hundred terms.
const SINGLE: Tolerance = Tolerance { absolute: 2e-5, relative: 2e-5 };

/// A process opens the adapter once.
fn device(test: &str) -> Option<Device> {
    static DEVICE: LazyLock<Result<Device, String>> =
        LazyLock::new(|| Device::wgpu_options().init().map_err(|error| error.to_string()));
    DEVICE.as_ref().map_err(|error| skip_without_graphics(test, error)).ok().cloned()
}

#[test]
fn every_operation_and_its_gradients_on_wgpu() {
    let Some(device) = device("every_operation_and_its_gradients_on_wgpu").map(Device::autodiff) else { return };
    for case in all() {
        let expected = differentiated(case.burns, &case.inputs, &Device::flex().autodiff(), DType::F64);
        let found = differentiated(case.ours, &case.inputs, &device, DType::F32);
        for (at, (found, expected)) in found.into_iter().zip(expected).enumerate() {
            SINGLE.assert(found, expected, &format!("{}, result and gradients, number {at}", case.name));
        }
    }
}

/// Numbers of 11 bits, on values of order one with sums of up to a few hundred terms.
const HALF: Tolerance = Tolerance { absolute: 1e-2, relative: 1e-2 };

#[test]
fn products_in_float16_are_rounded_and_everything_else_is_exact() {
    let test = "products_in_float16_are_rounded_and_everything_else_is_exact";
    let Some(device) = device(test) else { return };
    if !device.supports_dtype(FloatDType::F16) {
        skip(test, "the adapter's shaders have no 16-bit floats");
        return;
    }
    for case in all() {
        let inputs =
            || case.inputs.iter().zip(1..).map(|(&count, seed)| tensor(uniform(count, seed), &device, DType::F32));
        let [exact, half] = [MatmulPrecision::F32, MatmulPrecision::F16].map(|precision| {
            let out = precision.scope(|| (case.ours)(&inputs().collect::<Vec<_>>()));
            assert_eq!(out.dtype(), DType::F32, "{}", case.name);
            values(out)
        });
        let has_products = ["linear", "attention"].iter().any(|name| case.name.contains(name));
        assert_eq!(exact != half, has_products, "{}", case.name);
        HALF.assert(half, exact, case.name);
    }
}

/// The result, and the gradients of a fixed weighted sum of it by each input.
fn differentiated(operation: Function, sizes: &[usize], device: &Device, dtype: DType) -> Vec<Vec<f64>> {
    let inputs = sizes.iter().zip(1..);
    let inputs: Vec<Tensor<1>> =
        inputs.map(|(&count, seed)| tensor(uniform(count, seed), device, dtype).require_grad()).collect();
    let out = operation(&inputs);
    let gradients = (out.clone() * tensor(uniform(out.dims()[0], 99), device, dtype)).sum().backward();
    let mut all = vec![values(out)];
    all.extend(inputs.iter().map(|input| values(input.grad(&gradients).unwrap())));
    all
}

fn tensor(values: Vec<f64>, device: &Device, dtype: DType) -> Tensor<1> {
    let count = values.len();
    Tensor::from_data(TensorData::new(values, [count]), (device, dtype))
}

fn values(tensor: Tensor<1>) -> Vec<f64> {
    tensor.into_data_as::<f64>().try_to_vec().unwrap()
}

/// Values in [−1, 1) that f32 can hold.
fn uniform(count: usize, seed: u64) -> Vec<f64> {
    let mut random = SplitMix64::new(seed);
    (0..count).map(|_| f64::from(2.0 * random.unit_f32() - 1.0)).collect()
}
