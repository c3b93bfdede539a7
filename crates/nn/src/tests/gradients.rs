use atsplat_numeric::Tolerance;
use burn::Tensor;
use burn::tensor::{DType, Device};

use super::cases::{Case, Function, all};
use super::{tensor, uniform, values};

/// f64 on both sides, but burn's backward pass rounds the scalar of a division to f32.
const SAME_FORMULA: Tolerance = Tolerance { absolute: 1e-9, relative: 1e-7 };
/// Central differences of fourth order in f64, with steps of 3e-4.
const DIFFERENCES: Tolerance = Tolerance { absolute: 1e-9, relative: 1e-9 };
/// f32 against f64, on values of order one with sums of up to a few hundred terms.
const SINGLE: Tolerance = Tolerance { absolute: 2e-5, relative: 2e-5 };

/// The output, and the gradients of a fixed weighted sum of it.
fn differentiated(function: Function, inputs: &[Vec<f64>], dtype: DType) -> (Vec<f64>, Vec<Vec<f64>>) {
    let device = Device::flex().autodiff();
    let inputs: Vec<Tensor<1>> =
        inputs.iter().map(|input| tensor(input, [input.len()], dtype, &device).require_grad()).collect();
    let out = function(&inputs);
    let gradients = weighed(out.clone(), &device).backward();
    (values(out), inputs.iter().map(|input| values(input.grad(&gradients).unwrap())).collect())
}

fn weighed(out: Tensor<1>, device: &Device) -> Tensor<1> {
    let weights = uniform(out.dims()[0], 99);
    let dtype = out.dtype();
    (out * tensor(&weights, [weights.len()], dtype, device)).sum()
}

fn inputs(case: &Case) -> Vec<Vec<f64>> {
    case.inputs.iter().zip(1..).map(|(&count, seed)| uniform(count, seed)).collect()
}

fn assert_same(actual: (Vec<f64>, Vec<Vec<f64>>), expected: &(Vec<f64>, Vec<Vec<f64>>), within: Tolerance, what: &str) {
    within.assert(actual.0, expected.0.clone(), &format!("{what}, result"));
    for (at, (actual, expected)) in actual.1.into_iter().zip(&expected.1).enumerate() {
        within.assert(actual, expected.clone(), &format!("{what}, gradient of input {at}"));
    }
}

/// Other element types use the generic implementation, which f64 tests on this device.
#[test]
fn the_generic_implementation_agrees_with_burns_operations() {
    for case in all() {
        let inputs = inputs(&case);
        let expected = differentiated(case.burns, &inputs, DType::F64);
        assert_same(differentiated(case.ours, &inputs, DType::F64), &expected, SAME_FORMULA, case.name);
    }
}

#[test]
fn kernels_agree_with_the_generic_implementation() {
    #[expect(clippy::cast_possible_truncation, reason = "rounding to f32 is meant")]
    let round = |x: &f64| f64::from(*x as f32);
    for case in all() {
        let inputs = inputs(&case);
        let rounded: Vec<Vec<f64>> = inputs.iter().map(|input| input.iter().map(round).collect()).collect();
        let expected = differentiated(case.ours, &rounded, DType::F64);
        assert_same(differentiated(case.ours, &rounded, DType::F32), &expected, SINGLE, case.name);
    }
}

#[test]
fn gradients_agree_with_central_differences() {
    const STEP: f64 = 3e-4;
    const PROBES: usize = 24;
    let device = Device::flex();
    for case in all() {
        let inputs = inputs(&case);
        let (_, gradients) = differentiated(case.ours, &inputs, DType::F64);
        let loss = |inputs: &[Vec<f64>]| {
            let inputs: Vec<_> = inputs.iter().map(|x| tensor(x, [x.len()], DType::F64, &device)).collect();
            values(weighed((case.ours)(&inputs), &device))[0]
        };
        for (which, gradient) in gradients.iter().enumerate() {
            for place in (0..gradient.len()).step_by(gradient.len().div_ceil(PROBES)) {
                let moved = |step: f64| {
                    let mut inputs = inputs.clone();
                    inputs[which][place] += step;
                    loss(&inputs)
                };
                let [near, far] = [STEP, 2.0 * STEP].map(|step| moved(step) - moved(-step));
                let slope = (8.0 * near - far) / (12.0 * STEP);
                DIFFERENCES.assert([gradient[place]], [slope], &format!("{}, input {which} at {place}", case.name));
            }
        }
    }
}
