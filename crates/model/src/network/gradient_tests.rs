//! Gradients through the renderer reach every parameter and agree with central differences.

use atsplat_camera::{Camera, NormalizedIntrinsics, WorldFromCamera};
use atsplat_numeric::Tolerance;
use atsplat_splat::{Channels, RenderOptions, RendererConstants, SMALLEST_MIN_ALPHA, StoppedGradients, View};
use glam::{DMat3, DVec3};
use indexmap::IndexMap;

use super::*;
use crate::ImageSize;
use crate::config::HeadFrame;
use crate::hash::Stream;
use crate::parameters::parameters;
use crate::weights::{StoredTensor, StoredTensors, generated};

const SIZE: ImageSize = ImageSize::new(64, 64);
/// f32 through twenty layers, and a loss whose curvature affects differences.
const DIFFERENCES: Tolerance = Tolerance { absolute: 0.0, relative: 0.02 };

fn camera(x: f64) -> Camera {
    let pose = WorldFromCamera::new(DMat3::from_rotation_y(-0.2 * x), DVec3::new(x, 0.0, 0.0)).unwrap();
    Camera::pinhole(pose.inverse(), NormalizedIntrinsics::new(0.9, 0.9, 0.5, 0.5).unwrap())
}

fn noise(name: &str, count: usize) -> Vec<f32> {
    let stream = Stream::named(5, name);
    #[expect(clippy::cast_possible_truncation, reason = "images are f32")]
    (0..count as u64).map(|at| (0.5 + 0.5 * stream.signed_unit(at)) as f32).collect()
}

/// `nano` with Gaussians that are large enough to be visible and so faint that depth order hardly matters: where two change
/// order the image jumps, which affects differences but not derivatives.
fn config() -> ModelConfig {
    let text = ModelConfig::text_of("nano").unwrap();
    let text = text
        .replace("shift = -6.9, max = -1.2", "shift = -2.0, max = -0.5")
        .replace("shift = -2.0 }\n", "shift = -4.0 }\n");
    ModelConfig::from_toml(&text).unwrap()
}

/// Training losses of one scene: the error of the final and intermediate images, and of the predicted uncertainty.
struct Losses {
    images: Tensor<1>,
    uncertainty: Tensor<1>,
    selected: Vec<Vec<usize>>,
}

fn losses(network: &Network) -> Losses {
    let cameras = vec![camera(0.0), camera(0.5)];
    let views = Views::new(SIZE, noise("pictures", 2 * 64 * 64 * 3), cameras).unwrap();
    let forward = network.forward(&[views], 0).unwrap();
    let size = atsplat_camera::ImageSize { width: 32, height: 32 };
    let targets = [View { camera: camera(0.2), size }, View { camera: camera(0.4), size }];
    let device = network.device();
    let truth = Tensor::<1>::from_floats(noise("targets", 2 * 32 * 32 * 3).as_slice(), &device).reshape([2, 32, 32, 3]);
    // Almost no cut-offs, so that the loss is differentiable almost everywhere.
    let constants =
        RendererConstants { min_alpha: SMALLEST_MIN_ALPHA, min_transmittance: 0.0, ..RendererConstants::default() };
    let options = RenderOptions { constants, ..RenderOptions::default() };
    let with_scalars = RenderOptions {
        channels: Channels { scalar: true, ..Channels::default() },
        gradients: StoppedGradients { scalar_stops: true, ..StoppedGradients::default() },
        ..options.clone()
    };

    let error = |rgb: Tensor<4>| (rgb - truth.clone()).square();
    let last = forward.gaussians.render(0, &targets, &options, None).unwrap();
    let mut loss = error(last.rgb).mean();
    let mut uncertainty = Tensor::<1>::zeros([1], &device);
    let mut selected = Vec::new();
    for pair in forward.blocks.windows(2) {
        let [before, block] = pair else { continue };
        let expanded = block.expanded.as_ref().unwrap();
        let scores = expanded.scores.clone().unwrap().unsqueeze_dim::<3>(2).repeat_dim(2, 16).reshape([-1]);
        let images = network.gaussians(&before.tokens).render(0, &targets, &with_scalars, Some(scores)).unwrap();
        let map = error(images.rgb.clone()).mean_dim(3).squeeze_dim::<3>(3).detach();
        uncertainty = uncertainty + (images.scalar.unwrap() - map).abs().mean();
        loss = loss + error(images.rgb).mean() * 0.5;
        selected.push(expanded.selected[0].clone());
    }
    Losses { images: loss, uncertainty, selected }
}

fn network(config: &ModelConfig, weights: &StoredTensors, device: &Device) -> Network {
    Network::new(config, device).unwrap().with_weights(weights).unwrap()
}

#[test]
fn every_parameter_has_a_gradient_through_the_renderer() {
    let config = config();
    let weights = generated(&parameters(&config), 3);
    let network = network(&config, &weights, &Device::flex().autodiff());
    let Losses { images, uncertainty, .. } = losses(&network);
    let reached = network.gradients(&(images + uncertainty * 0.1).backward());
    for parameter in parameters(&config) {
        let gradient = reached.get(&parameter.name).unwrap_or_else(|| panic!("{} has no gradient", parameter.name));
        assert_eq!(gradient.len(), parameter.elements(), "{}", parameter.name);
        assert!(gradient.iter().all(|number| number.is_finite()), "{}", parameter.name);
        let moved = gradient.iter().filter(|number| **number != 0.0).count();
        assert!(moved > 0, "{} has a gradient of zeros", parameter.name);
    }
}

#[test]
fn the_uncertainty_loss_reaches_only_the_score_heads() {
    let config = config();
    let weights = generated(&parameters(&config), 3);
    let network = network(&config, &weights, &Device::flex().autodiff());
    let reached = network.gradients(&losses(&network).uncertainty.backward());
    for (name, gradient) in reached {
        let moved = gradient.iter().any(|number| *number != 0.0);
        assert_eq!(moved, name.contains("expansion.score"), "{name}");
    }
}

/// The loss of one of two renderings has an infinite derivative at one pixel of its second view.
#[test]
fn a_backward_pass_that_fails_says_why() {
    let config = config();
    let network = network(&config, &generated(&parameters(&config), 3), &Device::flex().autodiff());
    let views = Views::new(SIZE, noise("pictures", 2 * 64 * 64 * 3), vec![camera(0.0), camera(0.5)]).unwrap();
    let gaussians = network.forward(&[views], 0).unwrap().gaussians;
    let size = atsplat_camera::ImageSize { width: 8, height: 4 };
    let targets = [View { camera: camera(0.2), size }, View { camera: camera(0.4), size }];
    let render = || gaussians.render(0, &targets, &RenderOptions::default(), None).unwrap();
    let (whole, broken) = (render(), render());
    let mut weights = vec![1.0f32; 2 * 4 * 8 * 3];
    weights[3 * (32 + 13) + 1] = f32::INFINITY;
    let weights = Tensor::<1>::from_floats(weights.as_slice(), &network.device()).reshape([2, 4, 8, 3]);
    let loss = whole.rgb.sum() + (broken.rgb * weights).sum();
    assert_eq!(broken.backward.failure(), None, "it has not run");
    let reached = network.gradients(&loss.backward());
    assert!(reached.values().flatten().any(|number| number.is_nan()), "as the graph shows it");
    let failure = broken.backward.failure();
    let expected = "rgb gradient: expected finite numbers, found inf at pixel 13";
    assert_eq!((whole.backward.failure(), failure.as_deref()), (None, Some(expected)));
}

#[test]
fn gradients_agree_with_central_differences() {
    let config = config();
    let weights = generated(&parameters(&config), 3);
    let tracked = network(&config, &weights, &Device::flex().autodiff());
    let start = losses(&tracked);
    let by_images = tracked.gradients(&start.images.backward());
    // A graph can be propagated only once, so the losses are computed again.
    let by_uncertainty = tracked.gradients(&losses(&tracked).uncertainty.backward());
    for name in [
        "backbone.embed.weight",
        "coarse.plucker.weight",
        "coarse.layers.0.attn.qkv.weight",
        "coarse.layers.3.mlp.fc1.weight",
        "anchors.depth.mlp.fc2.weight",
        "anchors.context.fc1.weight",
        "fine.patch.weight",
        "fine.layers.0.norm1.weight",
        "decoder.blocks.0.layers.0.cross.q_norm.weight",
        "decoder.blocks.2.expansion.children.weight",
        "decoder.blocks.3.layers.1.cross.kv.weight",
        "head.norm.weight",
        "head.mlp.fc2.weight",
    ] {
        check(&config, &weights, name, &by_images, &start.selected, |losses| losses.images);
    }
    for block in 1..4 {
        let name = format!("decoder.blocks.{block}.expansion.score.mlp.fc1.weight");
        check(&config, &weights, &name, &by_uncertainty, &start.selected, |losses| losses.uncertainty);
    }
}

/// Without the depth head, whose differences are dominated by Gaussians that change order; `patch_frame` tests its
/// derivative in closed form.
#[test]
fn gradients_in_the_patch_frame_agree_with_central_differences() {
    let mut config = config();
    config.head.frame = HeadFrame::Patch;
    let weights = generated(&parameters(&config), 3);
    let tracked = network(&config, &weights, &Device::flex().autodiff());
    let start = losses(&tracked);
    let gradients = tracked.gradients(&start.images.backward());
    for name in [
        "coarse.plucker.weight",
        "decoder.blocks.2.expansion.children.weight",
        "head.norm.weight",
        "head.mlp.fc2.weight",
    ] {
        check(&config, &weights, name, &gradients, &start.selected, |losses| losses.images);
    }
}

/// Compares the slope along the gradient plus equally long noise, with steps that change no selection.
fn check(
    config: &ModelConfig,
    weights: &StoredTensors,
    name: &str,
    gradients: &IndexMap<String, Vec<f32>>,
    selected: &[Vec<usize>],
    loss: fn(Losses) -> Tensor<1>,
) {
    let gradient: Vec<f64> = gradients[name].iter().copied().map(f64::from).collect();
    let noise = Stream::named(1, name);
    let noise: Vec<f64> = (0..gradient.len() as u64).map(|at| noise.signed_unit(at)).collect();
    let (long, wide) = (length(&gradient), length(&noise));
    let direction: Vec<f64> = gradient.iter().zip(&noise).map(|(g, n)| g / long + n / wide).collect();
    let expected: f64 = gradient.iter().zip(&direction).map(|(g, d)| g * d).sum();

    let values = weights.tensors[name].to_f32().unwrap();
    let size = length(&values.iter().copied().map(f64::from).collect::<Vec<f64>>());
    let at = |step: f64| {
        let mut moved = weights.clone();
        #[expect(clippy::cast_possible_truncation, reason = "weights are f32")]
        let values: Vec<f32> =
            values.iter().zip(&direction).map(|(value, d)| (f64::from(*value) + step * d) as f32).collect();
        let shape = moved.tensors[name].shape().to_vec();
        moved.tensors[name] = StoredTensor::from_f32(shape, &values).unwrap();
        let losses = losses(&network(config, &moved, &Device::flex()));
        (losses.selected == selected).then(|| f64::from(loss(losses).into_scalar::<f32>()))
    };
    let slope = |step: f64| Some((at(step)? - at(-step)?) / (2.0 * step));
    let slopes: Vec<f64> = (0..14).filter_map(|halvings| slope(0.01 * size / f64::from(1 << halvings))).collect();
    let found = settled(&slopes).unwrap_or_else(|| panic!("{name}: every step changes a selection"));
    DIFFERENCES.assert([found], [expected], name);
}

/// The derivative estimated from slopes over shorter and shorter steps: the effect of curvature shrinks with the step, while
/// rounding and jumps within the step grow. So the two neighbours that agree best are used, the earlier of equals.
fn settled(slopes: &[f64]) -> Option<f64> {
    let apart = |pair: &&[f64]| (pair[1] - pair[0]).abs();
    let best = slopes.windows(2).min_by(|a, b| apart(a).total_cmp(&apart(b)))?;
    Some(f64::midpoint(best[0], best[1]))
}

fn length(vector: &[f64]) -> f64 {
    vector.iter().map(|number| number * number).sum::<f64>().sqrt()
}
