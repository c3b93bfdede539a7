//! Gradients of one sample: which parameters they reach, stop-gradients, terms, hard cases.

use crate::common::{config, sample};
use atsplat_model::network::{Device, Network, f32_values};
use atsplat_model::weights::StoredTensors;
use atsplat_numeric::Tolerance;
use atsplat_train::samples::{PatchDistances, Sample};
use atsplat_train::{Evaluation, FaultKind, LossConfig, Objective, Parameters, SampleGradients};

fn network() -> Network {
    let model = config("").model.config().unwrap();
    let parameters = Parameters::fresh(&model, 5, StoredTensors::default());
    parameters.network(&Network::new(&model, &Device::flex().autodiff()).unwrap()).unwrap()
}

fn gradients(losses: LossConfig, sample: &Sample) -> Result<SampleGradients, FaultKind> {
    Objective::new(losses).unwrap().gradients(&network(), sample, None, 0, 0.0)
}

/// Names of parameters with a gradient other than zero.
fn moved(gradients: &SampleGradients) -> Vec<&str> {
    let moved = gradients.gradients.iter().filter(|(_, values)| values.iter().any(|value| *value != 0.0));
    moved.map(|(name, _)| name.as_str()).collect()
}

const NOTHING: LossConfig = LossConfig {
    perceptual: atsplat_train::PerceptualChoice::DSsim,
    perceptual_weight: 0.0,
    intermediate_weight: 0.0,
    intermediate_d_ssim_weight: 0.0,
    uncertainty_weight: 0.0,
    distance_weight: 0.0,
    distance_until: 0.6,
    intermediate_targets: None,
    background: [0.0; 3],
};

#[test]
fn every_parameter_has_a_gradient_and_the_total_is_the_weighted_sum() {
    let result = gradients(LossConfig::default(), &sample(1)).unwrap();
    let names: Vec<String> = result.gradients.keys().cloned().collect();
    assert_eq!(moved(&result).len(), names.len());
    assert_eq!(names.len(), atsplat_model::parameters::parameters(&config("").model.config().unwrap()).len());
    let terms = result.terms;
    let sum = terms.mse
        + 0.5 * terms.perceptual
        + 0.5 * (terms.intermediate_mse + 0.5 * terms.intermediate_d_ssim)
        + 0.1 * terms.uncertainty;
    Tolerance::relative(1e-6).assert([terms.total], [sum], "total");
    assert!(terms.named().iter().all(|(name, value)| *value > 0.0 || *name == "distance"), "{terms:?}");
}

/// Paper, "Learning uncertainty in 2D space": "this loss updates only" the score heads. If renders equal the ground truth,
/// MSE has no gradient and only the uncertainty loss is left.
#[test]
fn the_uncertainty_loss_reaches_only_the_score_heads() {
    let mut sample = sample(2);
    let renders = Evaluation::from_samples(Vec::new(), [0.0; 3]).renders(&network(), &sample).unwrap();
    sample.targets.pictures = renders.into_iter().flat_map(atsplat_pixels::Image::into_samples).collect();
    assert!(moved(&gradients(NOTHING, &sample).unwrap()).is_empty());
    let result = gradients(LossConfig { uncertainty_weight: 1.0, ..NOTHING }, &sample).unwrap();
    let heads = result.gradients.keys().filter(|name| name.contains("expansion.score"));
    let heads: Vec<&str> = heads.map(String::as_str).collect();
    assert_eq!(heads.len(), 9);
    assert_eq!(moved(&result), heads);
}

#[test]
fn the_rendering_losses_do_not_reach_the_score_heads() {
    let result = gradients(LossConfig { uncertainty_weight: 0.0, ..LossConfig::default() }, &sample(2)).unwrap();
    assert!(moved(&result).iter().all(|name| !name.contains("score")), "{:?}", moved(&result));
}

#[test]
fn fewer_intermediate_targets_do_not_change_the_final_terms() {
    let all = gradients(LossConfig::default(), &sample(4)).unwrap().terms;
    let one = LossConfig { intermediate_targets: std::num::NonZeroUsize::new(1), ..LossConfig::default() };
    let fewer = gradients(one, &sample(4)).unwrap().terms;
    Tolerance::EXACT.assert([all.mse, all.perceptual], [fewer.mse, fewer.perceptual], "final renders");
    assert!(!Tolerance::EXACT.accepts(all.intermediate_mse, fewer.intermediate_mse));
}

/// Exact distances twice the predicted ones: |ln ½| each. Of all weights, only those before the decoder change distances.
#[test]
fn exact_distances_reach_what_predicts_depth_and_fade_out() {
    let mut sample = sample(3);
    let network = network();
    let forward = network.forward(&[sample.context.views().unwrap()], 0).unwrap();
    let distances = f32_values(forward.initial.depths.unwrap()).into_iter().map(|distance| 2.0 * distance).collect();
    sample.distances = Some(PatchDistances { columns: 2, distances });
    let only = LossConfig { distance_weight: 0.5, distance_until: 0.8, ..NOTHING };
    let objective = Objective::new(only).unwrap();
    let at = |share: f64| objective.gradients(&network, &sample, None, 0, share).unwrap();
    for (share, weight) in [(0.0, 0.5), (0.2, 0.375), (0.8, 0.0), (1.0, 0.0)] {
        let result = at(share);
        let distance = if weight > 0.0 { 2f64.ln() } else { 0.0 };
        let expected = [distance, result.terms.mse + weight * distance];
        Tolerance::relative(1e-5).assert([result.terms.distance, result.terms.total], expected, "terms");
    }
    let (first, last) = (at(0.0), at(1.0));
    let differ = |name: &str| first.gradients[name] != last.gradients[name];
    assert!(differ("anchors.depth.mlp.fc2.weight"), "the depth head");
    assert!(first.gradients.keys().filter(|name| name.starts_with("decoder.")).all(|name| !differ(name)));
}

fn with(change: impl Fn(&mut Sample)) -> Sample {
    let mut changed = sample(6);
    change(&mut changed);
    changed
}

#[test]
fn black_pictures_and_identical_views_give_finite_gradients() {
    let black = with(|sample| {
        sample.context.pictures.fill(0.0);
        sample.targets.pictures.fill(0.0);
    });
    let one_view = with(|sample| {
        let (picture, camera) = (sample.context.picture(0).to_vec(), sample.context.cameras[0]);
        sample.context.pictures = [picture.clone(), picture].concat();
        sample.context.cameras = vec![camera; 2];
    });
    let same_targets = with(|sample| sample.targets = sample.context.clone());
    for sample in [black, one_view, same_targets] {
        let result = gradients(LossConfig::default(), &sample).unwrap();
        assert!(result.terms.total.is_finite());
        assert!(result.gradients.values().flatten().all(|value| value.is_finite()));
    }
}

#[test]
fn a_picture_that_is_not_finite_is_named() {
    for broken in [f32::NAN, f32::INFINITY] {
        let context = with(|sample| sample.context.pictures[40] = broken);
        let target = with(|sample| *sample.targets.pictures.last_mut().unwrap() = broken);
        let default = LossConfig::default;
        assert_eq!(gradients(default(), &context).unwrap_err(), FaultKind::Picture("context picture 0".to_owned()));
        assert_eq!(gradients(default(), &target).unwrap_err(), FaultKind::Picture("target picture 1".to_owned()));
    }
}
