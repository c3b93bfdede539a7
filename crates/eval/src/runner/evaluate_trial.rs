use std::path::Path;

use atsplat_metrics::Suite;
use atsplat_protocol::trial::{ImageDigests, TargetImages, Trial};
use atsplat_results::{TargetRow, TrialRow};

use super::evaluate::{DecodedTrial, Evaluation};
use super::group_run::key_of;
use super::kept_images::{ChosenSoFar, ImageSink};
use super::{Dataset, KeepImages};
use crate::EvalError;
use crate::method::Method;

/// The rows of one trial under one method, as [`super::run()`] stores them; a method that fails gives failed rows.
///
/// # Errors
/// [`EvalError::Io`] if a file for the method cannot be written, or its process cannot be started again. That is no result of the
/// method.
pub fn evaluate_trial(
    dataset: &Dataset,
    suite: &Suite,
    trial: Trial,
    targets: &TargetImages,
    method: &dyn Method,
) -> Result<(TrialRow, Vec<TargetRow>), EvalError> {
    let bound = method.for_scenes_of(&[&dataset.index.index]);
    let method = bound.as_deref().unwrap_or(method);
    let (keep, store, chosen) = (KeepImages::Nothing, Path::new(""), ChosenSoFar::default());
    let evaluation = Evaluation { preset: &dataset.preset, suite, images: ImageSink { keep, store, chosen: &chosen } };
    let key = key_of(dataset, method, trial.scene(), trial.entry_number());
    evaluation.rows(key, None, &DecodedTrial::new(trial, targets, &ImageDigests::default()), method)
}
