//! Losses and optimiser against PyTorch (`oracle/make_fixtures.py`), and their invariants.

use atsplat_model::network::f32_values;
use atsplat_numeric::{Extremes as _, Tolerance};
use atsplat_tests::on_threads;
use atsplat_train::losses::{Stack, d_ssim, graph, log_distance, mse, uncertainty};
use atsplat_train::optimiser::{AdamW, Moments, Schedule, Update, clip, norm};
use burn::Tensor;
use burn::tensor::{Device, TensorData};
use proptest::prelude::*;
use serde::Deserialize;

/// Promised accuracy, relative to the largest entry of a gradient.
const PROMISED: f64 = 1e-4;
/// Accuracy that f32 gradients of f64 sums should reach.
const REACHED: f64 = 1e-6;
/// As `REACHED`, of D-SSIM in f32.
const REACHED_F32: f64 = 5e-6;

#[derive(Deserialize)]
struct Case {
    views: usize,
    height: usize,
    width: usize,
    render: Vec<f32>,
    truth: Vec<f32>,
    scalar: Vec<f32>,
    mse: f64,
    mse_gradient: Vec<f64>,
    d_ssim: f64,
    d_ssim_gradient: Vec<f64>,
    d_ssim_map: Vec<f64>,
    uncertainty: f64,
    uncertainty_gradient: Vec<f64>,
}

fn close(reached: f64, actual: &[f32], expected: &[f64], what: &str) {
    let largest = expected.iter().map(|value| value.abs()).fold(0.0, f64::maximum_of);
    const { assert!(REACHED < REACHED_F32 && REACHED_F32 < PROMISED) };
    let actual = actual.iter().copied().map(f64::from);
    Tolerance::absolute(reached * largest).assert(actual, expected.iter().copied(), what);
}

#[test]
fn losses_agree_with_pytorch() {
    let cases: Vec<Case> = serde_json::from_str(include_str!("fixtures/losses.json")).unwrap();
    assert_eq!(cases.len(), 3);
    for case in &cases {
        let stack = Stack { views: case.views, height: case.height, width: case.width };
        let error = mse(&case.render, &case.truth);
        close(REACHED, &error.gradient, &case.mse_gradient, "MSE's gradient");
        let dissimilarity = d_ssim(&case.render, &case.truth, stack);
        close(REACHED_F32, &dissimilarity.loss.gradient, &case.d_ssim_gradient, "D-SSIM's gradient");
        close(REACHED_F32, &dissimilarity.map, &case.d_ssim_map, "D-SSIM's map");
        let unsure = uncertainty(&case.scalar, &dissimilarity.map);
        close(REACHED, &unsure.gradient, &case.uncertainty_gradient, "uncertainty's gradient");
        let values = [error.value, dissimilarity.loss.value, unsure.value];
        Tolerance::relative(REACHED_F32).assert(values, [case.mse, case.d_ssim, case.uncertainty], "values");
    }
}

/// The same cases on tensors, whose gradients burn derives.
#[test]
fn losses_in_the_graph_agree_with_pytorch() {
    let device = Device::flex().autodiff();
    let cases: Vec<Case> = serde_json::from_str(include_str!("fixtures/losses.json")).unwrap();
    for case in &cases {
        let images = |values: &[f32]| {
            Tensor::<4>::from_data(TensorData::new(values.to_vec(), [case.views, case.height, case.width, 3]), &device)
        };
        let render = images(&case.render).require_grad();
        let gradient = |loss: &Tensor<1>| f32_values(render.grad(&loss.backward()).unwrap());
        let error = graph::mse(render.clone(), images(&case.truth), 1);
        close(REACHED_F32, &gradient(&error), &case.mse_gradient, "MSE's gradient");
        let map = graph::DSsim::new([case.height, case.width], &device).map(render.clone(), images(&case.truth));
        let dissimilarity = map.clone().mean();
        close(REACHED_F32, &gradient(&dissimilarity), &case.d_ssim_gradient, "D-SSIM's gradient");
        let map = map.mean_dim(1).squeeze_dim::<3>(1);
        close(REACHED_F32, &f32_values(map.clone()), &case.d_ssim_map, "D-SSIM's map");
        let scalar = TensorData::new(case.scalar.clone(), [case.views, case.height, case.width]);
        let scalar = Tensor::<3>::from_data(scalar, &device).require_grad();
        let unsure = graph::uncertainty(scalar.clone(), map, 1);
        let gradients = unsure.backward();
        close(
            REACHED_F32,
            &f32_values(scalar.grad(&gradients).unwrap()),
            &case.uncertainty_gradient,
            "uncertainty's gradient",
        );
        assert!(render.grad(&gradients).is_none(), "the error map is a constant");
        let values = [error, dissimilarity, unsure].map(|loss| f64::from(f32_values(loss)[0]));
        Tolerance::relative(REACHED_F32).assert(values, [case.mse, case.d_ssim, case.uncertainty], "values");
    }
}

/// Where rounding exceeds the variances, the divisor would be 0 or negative; the closed form's test has exact values.
#[test]
fn far_brighter_than_white_the_graph_agrees_with_the_closed_form() {
    let stack = Stack { views: 1, height: 23, width: 37 };
    let render: Vec<f32> = (0..stack.samples()).map(|at| 80.0 + 1e-4 * (at / 3 % stack.width) as f32).collect();
    let truth: Vec<f32> = (0..stack.samples()).map(|at| 0.6 + 0.1 * (at % 3) as f32).collect();
    let known = d_ssim(&render, &truth, stack);
    let device = Device::flex().autodiff();
    let images = |values: &[f32]| {
        Tensor::<4>::from_data(TensorData::new(values.to_vec(), [1, stack.height, stack.width, 3]), &device)
    };
    let tensor = images(&render).require_grad();
    let map = graph::DSsim::new([stack.height, stack.width], &device).map(tensor.clone(), images(&truth));
    let gradient = f32_values(tensor.grad(&map.clone().mean().backward()).unwrap());
    // In whatever order the f32 of the windows are summed, the cosine of the two gradients is 0.39 to 0.80, and negative if one of
    // them is negated or mirrored.
    let pairs = || gradient.iter().zip(&known.loss.gradient).map(|(a, b)| (f64::from(*a), f64::from(*b)));
    let [found, expected] = [&gradient, &known.loss.gradient]
        .map(|values| values.iter().map(|value| f64::from(*value).powi(2)).sum::<f64>().sqrt());
    assert!((0.75 * expected..1.35 * expected).contains(&found), "length of the gradient: {found:e} for {expected:e}");
    let cosine = pairs().map(|(found, expected)| found * expected).sum::<f64>() / (found * expected);
    assert!(cosine > 0.3, "cosine of the gradients: {cosine}");
    let half = 0.5 * pairs().map(|(_, expected)| expected.abs()).fold(0.0, f64::maximum_of);
    let large: Vec<_> = pairs().filter(|(_, expected)| expected.abs() > half).collect();
    assert!(large.iter().all(|(found, expected)| found * expected > 0.0), "signs: {large:?}");
    let map = f32_values(map.mean_dim(1).squeeze_dim::<3>(1)).into_iter().map(f64::from);
    Tolerance::absolute(0.03).assert(map, known.map.iter().copied().map(f64::from), "map");
}

/// Sky with any prediction, NaN nowhere hidden, and both directions.
#[test]
fn distances_in_the_graph_are_those_beside_it() {
    let device = Device::flex().autodiff();
    let exact = [2.0, 6.0, f32::INFINITY, 5.0];
    for predicted in [[4.0f32, 3.0, 7.0, 5.5], [1.0, 30.0, 0.0, 4.0]] {
        let known = log_distance(&predicted, &exact);
        let tensor = Tensor::<2>::from_floats([predicted], &device).require_grad();
        let loss = graph::log_distance(tensor.clone(), &[&exact]);
        let gradient = f32_values(tensor.grad(&loss.backward()).unwrap()).into_iter().map(f64::from);
        Tolerance::relative(1e-5).assert([f64::from(f32_values(loss)[0])], [known.value], "value");
        Tolerance::relative(1e-5).assert(gradient, known.gradient.into_iter().map(f64::from), "gradient");
    }
    let broken = graph::log_distance(Tensor::from_floats([[f32::NAN]], &device), &[&[2.0]]);
    assert!(f32_values(broken)[0].is_nan());
    let sky = graph::log_distance(Tensor::from_floats([[3.0]], &device), &[&[f32::INFINITY]]);
    Tolerance::EXACT.assert([f64::from(f32_values(sky)[0])], [0.0], "nothing but sky");
}

#[test]
fn equal_images_have_loss_and_gradient_0() {
    let stack = Stack { views: 1, height: 12, width: 13 };
    for value in [0.0, 0.5, 1.0] {
        let image = vec![value; stack.samples()];
        let dissimilarity = d_ssim(&image, &image, stack);
        Tolerance::F64.assert([dissimilarity.loss.value], [0.0], "D-SSIM of an image with itself");
        let gradient = dissimilarity.loss.gradient.iter().copied().map(f64::from);
        Tolerance::absolute(1e-9).assert(gradient, vec![0.0; stack.samples()], "its gradient");
        Tolerance::EXACT.assert([mse(&image, &image).value], [0.0], "MSE");
    }
}

#[test]
fn values_that_are_not_finite_propagate() {
    let stack = Stack { views: 1, height: 6, width: 6 };
    let truth = vec![0.5; stack.samples()];
    for broken in [f32::NAN, f32::INFINITY] {
        let mut render = truth.clone();
        render[40] = broken;
        assert!(!mse(&render, &truth).value.is_finite());
        assert!(!d_ssim(&render, &truth, stack).loss.value.is_finite());
        assert!(!uncertainty(&render, &truth).value.is_finite());
    }
    assert!(norm(&[vec![f32::NAN]]).is_nan());
}

proptest! {
    /// The same bits alone or together, on any number of threads.
    #[test]
    fn views_are_independent(seed in 0u32..1000, height in 1usize..20, width in 1usize..20) {
        let stack = Stack { views: 3, height, width };
        let numbers = |salt: u32| -> Vec<f32> {
            (0u32..).take(stack.samples()).map(|at| ((at ^ salt).wrapping_mul(2_654_435_761) >> 8) as f32 / 1e7).collect()
        };
        let (render, truth) = (numbers(seed), numbers(seed + 7));
        let together = d_ssim(&render, &truth, stack);
        let one = Stack { views: 1, ..stack };
        let length = one.samples();
        for view in 0..3 {
            let part = view * length..(view + 1) * length;
            let alone = d_ssim(&render[part.clone()], &truth[part.clone()], one);
            prop_assert_eq!(&alone.map[..], &together.map[view * one.pixels()..(view + 1) * one.pixels()]);
        }
        prop_assert_eq!(on_threads(1, || d_ssim(&render, &truth, stack)), together);
    }

    #[test]
    fn a_clipped_gradient_is_never_longer(values in prop::collection::vec(-1e3f32..1e3, 1..50), most in 0.01f64..10.0) {
        let length = norm(std::slice::from_ref(&values));
        let scale = clip(length, most);
        prop_assert!(scale <= 1.0 && length * scale <= most * (1.0 + 1e-12));
    }
}

#[derive(Deserialize)]
struct Optimised {
    start: Vec<Vec<f32>>,
    steps: Vec<Step>,
}

#[derive(Deserialize)]
struct Step {
    rate: f64,
    gradients: Vec<Vec<f32>>,
    norm: f64,
    after: Vec<Vec<f64>>,
}

#[test]
fn adam_w_and_clipping_agree_with_pytorch() {
    let run: Optimised = serde_json::from_str(include_str!("fixtures/adam_w.json")).unwrap();
    let optimiser = AdamW::default();
    let mut parameters = run.start;
    let mut moments: Vec<Moments> = parameters.iter().map(|values| Moments::zeros(values.len())).collect();
    for (step, update) in run.steps.iter().zip(1..) {
        let length = norm(&step.gradients);
        Tolerance::relative(1e-6).assert([length], [step.norm], "norm");
        let scale = clip(length, 1.0);
        for (position, (values, moments)) in parameters.iter_mut().zip(&mut moments).enumerate() {
            let update = Update { number: update, learning_rate: step.rate, scale };
            optimiser.step(update, values, &step.gradients[position], moments, position == 0);
            close(REACHED, values, &step.after[position], "parameters");
        }
    }
}

#[test]
fn the_learning_rate_warms_up_and_decays() {
    let schedule = Schedule { learning_rate: 1.0, warm_up_steps: 10, final_share: 0.1 };
    let rates: Vec<f64> = [0, 4, 9, 10, 60, 110, 500].into_iter().map(|step| schedule.rate(step, 110)).collect();
    Tolerance::F64.assert(rates, [0.1, 0.5, 1.0, 1.0, 0.55, 0.1, 0.1], "rates");
    let short = Schedule { warm_up_steps: 0, ..schedule };
    assert!((0..20).all(|step| short.rate(step, 0).is_finite() && short.rate(step, 1).is_finite()));
}
