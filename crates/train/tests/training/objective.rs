//! Gradients of one sample: which parameters they reach, stop-gradients, terms, hard cases.

use crate::common::{config, sample};
use atsplat_model::ImageSize;
use atsplat_model::network::{Device, Network, f32_values};
use atsplat_model::weights::StoredTensors;
use atsplat_numeric::Tolerance;
use atsplat_train::samples::{PatchDistances, Sample};
use atsplat_train::{Evaluation, FailureReason, GroupGradients, GroupInput, LossConfig, Objective, Parameters, Terms};

fn network() -> Network {
    let model = config("").model.config().unwrap();
    let parameters = Parameters::fresh(&model, 5, StoredTensors::default());
    parameters.network(&Network::new(&model, &Device::flex().autodiff()).unwrap()).unwrap()
}

fn gradients(losses: LossConfig, sample: &Sample) -> Result<GroupGradients, FailureReason> {
    let objective = Objective::new(losses).unwrap();
    let computed = objective.gradients(&network(), &GroupInput::new(std::slice::from_ref(sample)));
    computed.map_err(|failure| {
        assert_eq!(failure.sample, sample.name);
        failure.reason
    })
}

fn terms(losses: LossConfig, sample: &Sample) -> Terms {
    gradients(losses, sample).unwrap().terms[0]
}

/// Names of parameters with a gradient other than zero.
fn moved(gradients: &GroupGradients) -> Vec<&str> {
    let moved = gradients.gradients.iter().filter(|(_, values)| values.iter().any(|value| *value != 0.0));
    moved.map(|(name, _)| name.as_str()).collect()
}

const NOTHING: LossConfig = LossConfig {
    perceptual: atsplat_train::PerceptualChoice::DSsim,
    perceptual_weight: 0.0,
    late_perceptual_weight: None,
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
    let terms = result.terms[0];
    let sum = terms.mse
        + 0.5 * terms.perceptual
        + 0.5 * (terms.intermediate_mse + 0.5 * terms.intermediate_d_ssim)
        + 0.1 * terms.uncertainty;
    Tolerance::relative(1e-6).assert([terms.total], [sum], "total");
    assert!(terms.named().iter().all(|(name, value)| *value > 0.0 || *name == "distance"), "{terms:?}");
}

/// The loss is finite in f64; its gradients, which are f32, are not.
#[test]
fn a_backward_pass_that_fails_is_the_reason() {
    let losses = LossConfig { intermediate_weight: 1e300, ..NOTHING };
    let Err(FailureReason::Error(why)) = gradients(losses, &sample(1)) else { panic!("an error of the renderer") };
    let expected = "the backward pass of a rendering: rgb gradient: expected finite numbers, found ";
    assert!(why.starts_with(expected), "{why}");
}

/// Paper, "Learning uncertainty in 2D space": "this loss updates only" the score heads. If renders equal the ground truth,
/// MSE has no gradient and only the uncertainty loss is left.
#[test]
fn the_uncertainty_loss_reaches_only_the_score_heads() {
    let mut sample = sample(2);
    let renders = Evaluation::from_samples(Vec::new(), [0.0; 3]).renders(&network(), &sample).unwrap();
    sample.targets.images = renders.into_iter().flat_map(atsplat_pixels::Image::into_samples).collect();
    assert!(moved(&gradients(NOTHING, &sample).unwrap()).is_empty());
    let result = gradients(LossConfig { uncertainty_weight: 1.0, ..NOTHING }, &sample).unwrap();
    let heads = result.gradients.keys().filter(|name| name.contains("expansion.score"));
    let heads: Vec<&str> = heads.map(String::as_str).collect();
    assert_eq!(heads.len(), 9);
    assert_eq!(moved(&result), heads);
}

/// As inference does with the weights that the run writes.
#[test]
fn images_of_an_evaluation_are_resized_to_the_scale_of_the_training() {
    let (network, sample) = (network(), sample(2));
    let size = sample.context.views().unwrap().size();
    let half = ImageSize::new(size.height / 2, size.width / 2);
    let renders = |network: &Network| Evaluation::from_samples(Vec::new(), [0.0; 3]).renders(network, &sample).unwrap();
    let as_given = renders(&network);
    assert_eq!(renders(&network.clone().trained_at(size)), as_given);
    assert_ne!(renders(&network.trained_at(half)), as_given);
}

#[test]
fn the_rendering_losses_do_not_reach_the_score_heads() {
    let result = gradients(LossConfig { uncertainty_weight: 0.0, ..LossConfig::default() }, &sample(2)).unwrap();
    assert!(moved(&result).iter().all(|name| !name.contains("score")), "{:?}", moved(&result));
}

#[test]
fn fewer_intermediate_targets_do_not_change_the_final_terms() {
    let all = terms(LossConfig::default(), &sample(4));
    let one = LossConfig { intermediate_targets: std::num::NonZeroUsize::new(1), ..LossConfig::default() };
    let fewer = terms(one, &sample(4));
    Tolerance::EXACT.assert([all.mse, all.perceptual], [fewer.mse, fewer.perceptual], "final renders");
    assert!(!Tolerance::EXACT.accepts(all.intermediate_mse, fewer.intermediate_mse));
}

/// Exact distances twice the predicted ones: |ln ½| each. Of all weights, only those before the decoder change distances.
#[test]
fn exact_distances_reach_what_predicts_depth_and_fade_out() {
    let mut sample = sample(3);
    let network = network();
    let forward = network.forward(&[sample.context.views().unwrap()], 0).unwrap();
    let depths = f32_values(forward.initial.place.depths().unwrap().clone());
    let distances = depths.into_iter().map(|distance| 2.0 * distance).collect();
    sample.distances = Some(PatchDistances { columns: 2, distances });
    let only = LossConfig { distance_weight: 0.5, distance_until: 0.8, ..NOTHING };
    let objective = Objective::new(only).unwrap();
    let input = GroupInput::new(std::slice::from_ref(&sample));
    let at = |progress: f64| objective.gradients(&network, &GroupInput { progress, ..input }).unwrap();
    for (progress, weight) in [(0.0, 0.5), (0.2, 0.375), (0.8, 0.0), (1.0, 0.0)] {
        let result = at(progress);
        let distance = if weight > 0.0 { 2f64.ln() } else { 0.0 };
        let terms = result.terms[0];
        let expected = [distance, terms.mse + weight * distance];
        Tolerance::relative(1e-5).assert([terms.distance, terms.total], expected, "terms");
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
fn black_images_and_identical_views_give_finite_gradients() {
    let black = with(|sample| {
        sample.context.images.fill(0.0);
        sample.targets.images.fill(0.0);
    });
    let one_view = with(|sample| {
        let (image, camera) = (sample.context.image(0).to_vec(), sample.context.cameras[0]);
        sample.context.images = [image.clone(), image].concat();
        sample.context.cameras = vec![camera; 2];
    });
    let same_targets = with(|sample| sample.targets = sample.context.clone());
    for sample in [black, one_view, same_targets] {
        let result = gradients(LossConfig::default(), &sample).unwrap();
        assert!(result.terms[0].total.is_finite());
        assert!(result.gradients.values().flatten().all(|value| value.is_finite()));
    }
}

#[test]
fn an_image_that_is_not_finite_is_named() {
    for broken in [f32::NAN, f32::INFINITY] {
        let context = with(|sample| sample.context.images[40] = broken);
        let target = with(|sample| *sample.targets.images.last_mut().unwrap() = broken);
        let default = LossConfig::default;
        assert_eq!(
            gradients(default(), &context).unwrap_err(),
            FailureReason::NonFiniteImage("context image 0".to_owned())
        );
        assert_eq!(
            gradients(default(), &target).unwrap_err(),
            FailureReason::NonFiniteImage("target image 1".to_owned())
        );
    }
}

/// Three samples at once, every loss switched on: each has the same terms as alone, to the bit, and the gradients are sums.
#[test]
fn samples_together_have_their_terms_and_the_sum_of_their_gradients() {
    let mut model = config("").model.config().unwrap();
    model.expansion.selection = atsplat_model::config::Selection::Random { seed: 1 };
    let parameters = Parameters::fresh(&model, 5, StoredTensors::default());
    let network = parameters.network(&Network::new(&model, &Device::flex().autodiff()).unwrap()).unwrap();
    let exact = |number: usize| (0..8).map(|patch| 1.0 + (number * patch) as f32).collect();
    let samples = [0, 1, 2].map(|number| Sample {
        distances: Some(PatchDistances { columns: 2, distances: exact(number) }),
        ..sample(number as u64 + 7)
    });
    let objective = Objective::new(LossConfig { distance_weight: 0.2, ..LossConfig::default() }).unwrap();
    let gradients_of = |samples: &[Sample], call_seed| {
        objective.gradients(&network, &GroupInput { call_seed, ..GroupInput::new(samples) }).unwrap()
    };
    let together = gradients_of(&samples, 40);
    let alone: Vec<GroupGradients> =
        samples.iter().zip(40..).map(|(sample, seed)| gradients_of(std::slice::from_ref(sample), seed)).collect();
    assert_eq!(together.terms, alone.iter().map(|group| group.terms[0]).collect::<Vec<_>>());
    assert!(together.gradients.keys().eq(alone[0].gradients.keys()));
    for (name, found) in &together.gradients {
        let sums =
            (0..found.len()).map(|at| alone.iter().map(|group| f64::from(group.gradients[name][at])).sum::<f64>());
        let found = || found.iter().copied().map(f64::from);
        Tolerance::of_largest(2e-5, found()).assert(found(), sums, name);
    }
    let mut broken = samples;
    broken[1].targets.images[3] = f32::NAN;
    let failure = objective.gradients(&network, &GroupInput::new(&broken)).unwrap_err();
    assert_eq!(
        (failure.sample.as_str(), failure.reason),
        ("noise 8", FailureReason::NonFiniteImage("target image 0".to_owned()))
    );
}

/// Three samples in one group, the last with one target less, every term switched on: losses in the graph give the terms and
/// gradients of those outside it.
#[test]
fn losses_in_the_graph_have_the_same_terms_and_gradients() {
    let mut samples = [sample(6), sample(7), sample(8)];
    let fewer = &mut samples[2].targets;
    fewer.cameras.pop();
    fewer.images.truncate(fewer.images.len() / 2);
    let network = network();
    let views = samples.each_ref().map(|sample| sample.context.views().unwrap());
    let initial = network.forward(&views, 0).unwrap().initial;
    let depths = f32_values(initial.place.depths().unwrap().clone());
    for (sample, depths) in samples.iter_mut().zip(depths.chunks(depths.len() / 3)) {
        let mut distances: Vec<f32> = depths.iter().map(|distance| 1.5 * distance).collect();
        distances[0] = f32::INFINITY;
        sample.distances = Some(PatchDistances { columns: 2, distances });
    }
    let losses = LossConfig {
        distance_weight: 0.3,
        intermediate_targets: std::num::NonZeroUsize::new(1),
        background: [0.2, 0.4, 0.6],
        ..LossConfig::default()
    };
    let input = GroupInput::new(&samples);
    let outside = Objective::new(losses.clone()).unwrap().gradients(&network, &input).unwrap();
    let inside = Objective::in_graph(losses, &network.device()).unwrap();
    let named = inside.gradients(&network, &input).unwrap();
    for (found, expected) in named.terms.iter().zip(&outside.terms) {
        for ((name, found), (_, expected)) in found.named().into_iter().zip(expected.named()) {
            Tolerance::relative(1e-5).assert([found], [expected], name);
        }
    }
    assert_ne!(outside.terms[0], outside.terms[1]);
    assert_eq!(named.gradients.keys().collect::<Vec<_>>(), outside.gradients.keys().collect::<Vec<_>>());
    for (name, expected) in &outside.gradients {
        let expected = || expected.iter().copied().map(f64::from);
        let found = named.gradients[name].iter().copied().map(f64::from);
        Tolerance::of_largest(1e-4, expected()).assert(found, expected(), name);
    }
    let flat = inside.flat_gradient(&network, &input).unwrap();
    let squares = |values: &[f32]| values.iter().map(|value| f64::from(*value).powi(2)).sum::<f64>();
    let sum: f64 = named.gradients.values().map(|values| squares(values)).sum();
    Tolerance::relative(1e-5).assert([squares(&f32_values(flat.gradient))], [sum], "the gradient as one tensor");
}
