//! The learned loss against the metric of the same network, and its gradient against finite differences.

use atsplat_metrics::learned::{Lpips, LpipsNetwork, Step, WeightsHashes};
use atsplat_model::weights::{StoredTensor, StoredTensors};
use atsplat_numeric::SplitMix64;
use atsplat_numeric::Tolerance;
use atsplat_pixels::Image;
use atsplat_train::losses::{LpipsLoss, Stack};
use burn::tensor::Device;

/// f32 convolutions with another order of sums.
const VALUE: Tolerance = Tolerance::relative(1e-4);
const DIFFERENCES: Tolerance = Tolerance::relative(0.02);

fn numbers(name: &str, count: usize, bound: f32) -> Vec<f32> {
    let mut random = SplitMix64::for_scene(11, name);
    (0..count).map(|_| (2.0 * random.unit_f32() - 1.0) * bound).collect()
}

/// Weights from a seed, large enough that every layer contributes.
fn weights(network: LpipsNetwork) -> [StoredTensors; 2] {
    let [mut weights, mut heads] = [StoredTensors::default(), StoredTensors::default()];
    let add = |into: &mut StoredTensors, name: String, shape: Vec<usize>, bound: f32, least: f32| {
        let values: Vec<f32> = numbers(&name, shape.iter().product(), bound).into_iter().map(|v| v + least).collect();
        into.tensors.insert(name, StoredTensor::from_f32(shape, &values).unwrap());
    };
    for step in network.steps() {
        let Step::Convolution { name, channels_in, channels_out, kernel, .. } = step else { continue };
        let bound = (6.0 / (channels_in * kernel * kernel) as f32).sqrt();
        add(&mut weights, format!("{name}.weight"), vec![channels_out, channels_in, kernel, kernel], bound, 0.0);
        add(&mut weights, format!("{name}.bias"), vec![channels_out], 0.05, 0.0);
    }
    for (name, channels) in LpipsNetwork::heads().into_iter().zip(network.channels()) {
        add(&mut heads, name, vec![1, channels, 1, 1], 0.5, 0.5);
    }
    [weights, heads]
}

#[test]
fn the_learned_loss_equals_the_metric_and_has_its_gradient() {
    const SIDE: usize = 36;
    let stack = Stack { views: 1, height: SIDE, width: SIDE };
    let image = |name: &str| -> Vec<f32> { numbers(name, stack.samples(), 0.5).iter().map(|v| v + 0.5).collect() };
    let (render, truth) = (image("render"), image("truth"));
    let image = |samples: &[f32]| Image::new(36, 36, samples.to_vec()).unwrap();
    for network in LpipsNetwork::ALL {
        let [weights, heads] = weights(network);
        let loss = LpipsLoss::new(network, &weights, &heads, "seeded".to_owned(), &Device::flex().autodiff()).unwrap();
        let hashes = WeightsHashes { network: String::new(), heads: String::new() };
        let metric = Lpips::from_tensors(network, &weights, &heads, hashes).unwrap();
        let evaluated = loss.evaluate(&render, &truth, stack);
        let [of_render, of_truth] = [&render, &truth].map(|samples| metric.features(&image(samples)).unwrap());
        let expected = metric.distance(&of_render, &of_truth).unwrap();
        assert!(expected > 1e-3, "{network:?} sees a difference: {expected}");
        VALUE.assert([evaluated.value], [expected], network.name());

        let length = evaluated.gradient.iter().map(|g| f64::from(*g).powi(2)).sum::<f64>().sqrt();
        let at = |step: f64| {
            #[expect(clippy::cast_possible_truncation, reason = "images are f32")]
            let moved: Vec<f32> = render
                .iter()
                .zip(&evaluated.gradient)
                .map(|(value, gradient)| (f64::from(*value) + step * f64::from(*gradient) / length) as f32)
                .collect();
            loss.evaluate(&moved, &truth, stack).value
        };
        let slope = (at(0.05) - at(-0.05)) / 0.1;
        DIFFERENCES.assert([slope], [length], network.name());
    }
}

#[test]
fn identical_images_have_distance_0_and_a_finite_gradient() {
    let stack = Stack { views: 2, height: 36, width: 36 };
    let [weights, heads] = weights(LpipsNetwork::LpipsAlex);
    let loss =
        LpipsLoss::new(LpipsNetwork::LpipsAlex, &weights, &heads, String::new(), &Device::flex().autodiff()).unwrap();
    for value in [0.0, 0.7] {
        let image = vec![value; stack.samples()];
        let evaluated = loss.evaluate(&image, &image, stack);
        Tolerance::EXACT.assert([evaluated.value], [0.0], "distance");
        assert!(evaluated.gradient.len() == stack.samples() && evaluated.gradient.iter().all(|g| g.is_finite()));
    }
}

#[test]
fn names_absent_weights() {
    let [mut weights, heads] = weights(LpipsNetwork::LpipsAlex);
    weights.tensors.shift_remove("features.3.bias");
    let error = LpipsLoss::new(LpipsNetwork::LpipsAlex, &weights, &heads, String::new(), &Device::flex().autodiff())
        .unwrap_err()
        .to_string();
    assert!(error.contains("features.3.bias") && error.contains("[192]"), "{error}");
}
