//! Evaluations during training: which targets count.

use atsplat_model::network::{Device, Network};
use atsplat_model::weights::StoredTensors;
use atsplat_numeric::Tolerance;
use atsplat_train::journal::EvaluationRecord;
use atsplat_train::samples::Sample;
use atsplat_train::{Evaluation, Parameters, TrainError};

use crate::common::{SIZE, config, sample};

/// Values of an image.
const LENGTH: usize = SIZE.height * SIZE.width * 3;

fn evaluate(sample: Sample) -> Result<EvaluationRecord, TrainError> {
    let model = config("").model.config().unwrap();
    let parameters = Parameters::fresh(&model, 5, StoredTensors::default());
    let network = parameters.network(&Network::new(&model, &Device::flex()).unwrap()).unwrap();
    Evaluation::from_samples(vec![sample], [0.0; 3]).run(&network, 7)
}

/// The first `count` of two targets are their nearest context views.
fn with_copies(count: usize) -> Sample {
    let mut sample = sample(2);
    for (target, nearest) in sample.nearest().into_iter().enumerate().take(count) {
        let copy = sample.context.image(nearest).to_vec();
        sample.targets.images[target * LENGTH..(target + 1) * LENGTH].copy_from_slice(&copy);
    }
    sample
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
