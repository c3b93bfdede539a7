//! Evaluations during training: which targets count.

use atsplat_model::network::{Device, Network};
use atsplat_model::weights::StoredTensors;
use atsplat_numeric::Tolerance;
use atsplat_train::logs::EvaluationRecord;
use atsplat_train::samples::{RoomsConfig, RoomsSource, Sample};
use atsplat_train::{Evaluation, Parameters, Start, TrainConfig, TrainError, contact_sheet};
use tempfile::tempdir;

use crate::common::{Noise, SIZE, config, sample, trainer};

/// Values of an image.
const LENGTH: usize = SIZE.height * SIZE.width * 3;

/// For each target of a sample, at x = -0.3 and 0.4, the nearest of the context views, at x = -1 and 1.
const NEAREST: [usize; 2] = [0, 1];

fn network() -> Network {
    let model = config("").model.config().unwrap();
    let parameters = Parameters::fresh(&model, 5, StoredTensors::default());
    parameters.network(&Network::new(&model, &Device::flex()).unwrap()).unwrap()
}

fn evaluate(sample: Sample) -> Result<EvaluationRecord, TrainError> {
    Evaluation::from_samples(vec![sample], [0.0; 3]).run(&network(), 7)
}

/// The first `count` of two targets are their nearest context views.
fn with_copies(count: usize) -> Sample {
    let mut sample = sample(2);
    for (target, nearest) in NEAREST.into_iter().enumerate().take(count) {
        let copy = sample.context.image(nearest).to_vec();
        sample.targets.images[target * LENGTH..(target + 1) * LENGTH].copy_from_slice(&copy);
    }
    sample
}

#[test]
fn the_baseline_copies_the_context_view_with_the_nearest_camera() {
    assert_eq!(sample(2).nearest(), NEAREST);
}

#[test]
fn copies_of_context_views_are_counted_and_left_out_of_the_means() {
    let mut second = sample(2);
    second.targets.cameras.remove(0);
    second.targets.images.drain(..LENGTH);
    let [all, expected, found] = [with_copies(0), second, with_copies(1)].map(|sample| evaluate(sample).unwrap());
    assert_eq!([&all, &expected, &found].map(|record| (record.targets, record.identical)), [(2, 0), (1, 0), (1, 1)]);
    let means = |of: &EvaluationRecord| [of.psnr, of.ssim, of.nearest_view_psnr, of.nearest_view_ssim];
    Tolerance::absolute(1e-9).assert(means(&found), means(&expected), "the other target alone");
    assert!(found.nearest_view_psnr < 20.0, "noise: {}", found.nearest_view_psnr);
    let error = evaluate(with_copies(2)).unwrap_err().to_string();
    assert!(
        error.contains("a target that differs from the context views") && error.contains("found 2 identical"),
        "{error}"
    );
}

/// Of two targets, only the first is shown.
#[test]
fn contact_sheets_score_what_evaluations_count() {
    let row = |sample: Sample| {
        let evaluation = Evaluation::from_samples(vec![sample], [0.0; 3]);
        let mut rows = contact_sheet(&evaluation, &network(), 8, 1).unwrap();
        assert_eq!(rows.len(), 1);
        rows.remove(0)
    };
    for (copies, left_out) in [(0, vec![]), (1, vec![1])] {
        let found = row(with_copies(copies));
        let expected = evaluate(with_copies(copies)).unwrap().psnr;
        Tolerance::absolute(1e-9).assert([found.psnr.unwrap()], [expected], "the same targets");
        assert_eq!((found.targets.len(), found.left_out), (1, left_out));
    }
    let none = row(with_copies(2));
    assert!(none.psnr.is_none());
    assert_eq!((none.targets.len(), none.left_out), (1, vec![1, 2]));
}

/// The first sample has the size of images that the configuration does not state: 8 GiB are enough for 174762 samples of 4 views of 32×32.
#[test]
fn an_evaluation_that_does_not_fit_into_memory_is_an_error() {
    let open = |count| Evaluation::new(&Noise::CLEAN, 3, count, [0.0; 3]);
    assert_eq!(
        open(3).unwrap().samples().iter().map(|sample| &sample.name).collect::<Vec<_>>(),
        ["noise 0", "noise 1", "noise 2"]
    );
    let error = open(1_000_000_000_000).unwrap_err().to_string();
    assert!(error.contains("evaluation.samples: expected at most 174762: "), "{error}");
    assert!(error.contains("4 views of 32x32") && error.ends_with("found 1000000000000"), "{error}");
}

/// Context frames are three frames apart at the first step, and six from the ninth on.
#[test]
fn an_evaluation_draws_as_at_the_end_of_the_curriculum() {
    let text = "scenes-of = 'rooms'\nscenes = 2\nsize = [32, 32]\nsamples = 1\nstride = 10\n\
                views = { context = [2, 2], targets = 1, inset = 1, \
                gaps = { min = 6, max = 6, initial-min = 3, initial-max = 3, warm-up-steps = 9 } }";
    let source = RoomsSource::new(toml::from_str::<RoomsConfig>(text).unwrap(), config("").pose_normalisation);
    let evaluation = Evaluation::new(&source, 3, 4, [0.0; 3]).unwrap();
    assert_eq!(evaluation.samples().len(), 4);
    for Sample { name, .. } in evaluation.samples() {
        // As `rooms-train-00000001, frames [2, 8] to [5]`.
        let (context, _) = name.split_once(" frames [").unwrap().1.split_once(']').unwrap();
        let frames: Vec<usize> = context.split(", ").map(|frame| frame.parse().unwrap()).collect();
        assert_eq!(frames[1] - frames[0], 6, "{name}");
    }
}

#[test]
fn runs_that_differ_in_their_seed_have_the_same_evaluation_by_a_seed_of_its_own() {
    let digest = |seed: u64, of_evaluation: &str| {
        let views = "views = { context = [2, 2], targets = 1, gaps = { min = 3, max = 4 }, inset = 1 }";
        let rooms = "scenes-of = 'rooms', split = 'test', scenes = 2, size = [32, 32], samples = 1, stride = 10";
        let source = format!("source = {{ rooms = {{ {rooms}, {views} }} }}");
        let config = config(&format!("evaluation = {{ every = 4, samples = 3, {of_evaluation}{source} }}"));
        let folder = tempdir().unwrap();
        let trainer = trainer(TrainConfig { seed, ..config }, folder.path(), &Start::Fresh, Noise::CLEAN);
        trainer.evaluation().unwrap().digest()
    };
    let [own, other] = [3, 4].map(|seed| digest(seed, "seed = 7, "));
    assert_eq!(own, other);
    let [own, other] = [3, 4].map(|seed| digest(seed, ""));
    assert_ne!(own, other, "the samples of the run's seed");
    assert_eq!(digest(4, "seed = 3, "), own);
}

#[test]
fn an_evaluation_without_samples_is_not_said_to_be_of_training_data() {
    let text = "scenes-of = 'rooms'\nscenes = 1\nsize = [32, 32]\nsamples = 1\nstride = 10\n\
                views = { context = [2, 2], targets = 1, gaps = { min = 500, max = 600 } }";
    let rule = config("").pose_normalisation;
    let source = RoomsSource::new(toml::from_str::<RoomsConfig>(text).unwrap(), rule);
    let error = Evaluation::new(&source, 3, 1, [0.0; 3]).unwrap_err().to_string();
    assert!(error.starts_with("evaluation data: rooms train 0 to 0 at 32x32"), "{error}");
}
