//! What a lesson teaches, and whom: stop-gradients, terms, hard cases.

use crate::common::{config, sample};
use atsplat_model::network::{Device, Network};
use atsplat_model::weights::StoredTensors;
use atsplat_numeric::Tolerance;
use atsplat_train::samples::Sample;
use atsplat_train::{Evaluation, FaultKind, Lesson, LossConfig, Objective, Parameters};

fn network() -> Network {
    let model = config("").model.config().unwrap();
    let parameters = Parameters::fresh(&model, 5, StoredTensors::default());
    parameters.network(&Network::new(&model, &Device::flex().autodiff()).unwrap()).unwrap()
}

fn learn(losses: LossConfig, sample: &Sample) -> Result<Lesson, FaultKind> {
    Objective::new(losses).unwrap().learn(&network(), sample, None, 0)
}

/// Names of parameters that something pulls at.
fn moved(lesson: &Lesson) -> Vec<&str> {
    let pulled = lesson.gradients.iter().filter(|(_, values)| values.iter().any(|value| *value != 0.0));
    pulled.map(|(name, _)| name.as_str()).collect()
}

const NOTHING: LossConfig = LossConfig {
    perceptual: atsplat_train::PerceptualChoice::DSsim,
    perceptual_weight: 0.0,
    intermediate_weight: 0.0,
    intermediate_d_ssim_weight: 0.0,
    uncertainty_weight: 0.0,
    intermediate_targets: None,
    background: [0.0; 3],
};

#[test]
fn everything_learns_and_the_total_is_the_sum() {
    let lesson = learn(LossConfig::default(), &sample(1)).unwrap();
    let names: Vec<String> = lesson.gradients.keys().cloned().collect();
    assert_eq!(moved(&lesson).len(), names.len());
    assert_eq!(names.len(), atsplat_model::parameters::parameters(&config("").model.config().unwrap()).len());
    let terms = lesson.terms;
    let sum = terms.mse
        + 0.5 * terms.perceptual
        + 0.5 * (terms.intermediate_mse + 0.5 * terms.intermediate_d_ssim)
        + 0.1 * terms.uncertainty;
    Tolerance::relative(1e-6).assert([terms.total], [sum], "total");
    assert!(terms.named().iter().all(|(_, value)| *value > 0.0), "{terms:?}");
}

/// Paper, "Learning uncertainty in 2D space": "this loss updates only" the score heads. Where renders are the truth
/// itself, MSE pulls at nothing, and uncertainty is all there is.
#[test]
fn the_uncertainty_loss_moves_nothing_but_the_scorers() {
    let mut sample = sample(2);
    let renders = Evaluation::of(Vec::new(), [0.0; 3]).renders(&network(), &sample).unwrap();
    sample.targets.pictures = renders.into_iter().flat_map(atsplat_pixels::Image::into_samples).collect();
    assert!(moved(&learn(NOTHING, &sample).unwrap()).is_empty());
    let lesson = learn(LossConfig { uncertainty_weight: 1.0, ..NOTHING }, &sample).unwrap();
    let scorers = lesson.gradients.keys().filter(|name| name.contains("expansion.score"));
    let scorers: Vec<&str> = scorers.map(String::as_str).collect();
    assert_eq!(scorers.len(), 9);
    assert_eq!(moved(&lesson), scorers);
}

#[test]
fn the_rendering_losses_do_not_move_the_scorers() {
    let lesson = learn(LossConfig { uncertainty_weight: 0.0, ..LossConfig::default() }, &sample(2)).unwrap();
    assert!(moved(&lesson).iter().all(|name| !name.contains("score")), "{:?}", moved(&lesson));
}

#[test]
fn fewer_intermediate_targets_leave_the_final_renders_alone() {
    let all = learn(LossConfig::default(), &sample(4)).unwrap().terms;
    let one = LossConfig { intermediate_targets: std::num::NonZeroUsize::new(1), ..LossConfig::default() };
    let fewer = learn(one, &sample(4)).unwrap().terms;
    Tolerance::EXACT.assert([all.mse, all.perceptual], [fewer.mse, fewer.perceptual], "final renders");
    assert!(!Tolerance::EXACT.accepts(all.intermediate_mse, fewer.intermediate_mse));
}

fn with(change: impl Fn(&mut Sample)) -> Sample {
    let mut changed = sample(6);
    change(&mut changed);
    changed
}

#[test]
fn black_pictures_and_identical_views_are_lessons_like_others() {
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
        let lesson = learn(LossConfig::default(), &sample).unwrap();
        assert!(lesson.terms.total.is_finite());
        assert!(lesson.gradients.values().flatten().all(|value| value.is_finite()));
    }
}

#[test]
fn a_broken_picture_is_told_apart() {
    for broken in [f32::NAN, f32::INFINITY] {
        let context = with(|sample| sample.context.pictures[40] = broken);
        let target = with(|sample| *sample.targets.pictures.last_mut().unwrap() = broken);
        let default = LossConfig::default;
        assert_eq!(learn(default(), &context).unwrap_err(), FaultKind::Picture("context picture 0".to_owned()));
        assert_eq!(learn(default(), &target).unwrap_err(), FaultKind::Picture("target picture 1".to_owned()));
    }
}
