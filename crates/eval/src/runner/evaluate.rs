//! Evaluates one trial under one method.

use std::any::Any;
use std::collections::{BTreeMap, BTreeSet};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;
use std::sync::Arc;

use atsplat_files::panic_message;
use atsplat_metrics::Suite;
use atsplat_numeric::mean;
use atsplat_pixels::{Image, ImageU8};
use atsplat_protocol::Preset;
use atsplat_protocol::trial::{ImageDigests, TargetImages, Trial};
use atsplat_results::store::images::{self, CONTEXT, TRUTH, hash_of_bytes};
use atsplat_results::{MethodRecord, RecordKind, TargetRow, TargetStatus, TrialKey, TrialRow, TrialStatus};
use rayon::prelude::*;
use thiserror::Error;

use super::image_mistakes::{self, RenderAndTruth};
use super::kept_images::ImageSink;
use super::suspicious::{self, SuspiciousRender};
use super::target_row::{compare, hash_of, unscored_row};
use crate::EvalError;
use crate::method::{Cost, Method, MethodError, Prediction, Rendered, TrialInput};

/// Targets that are rendered in one batch.
const BATCH: usize = 4;

/// Settings of an evaluation.
#[derive(Clone, Copy, Debug)]
pub(super) struct Evaluation<'a> {
    pub(super) preset: &'a Preset,
    pub(super) suite: &'a Suite,
    /// Which images are stored.
    pub(super) images: ImageSink<'a>,
}

/// A trial with its decoded images.
pub(super) struct DecodedTrial {
    pub(super) trial: Trial,
    /// [`Trial::data_hash`] of the bytes that were decoded.
    pub(super) data_hash: String,
    context: Result<Vec<Arc<ImageU8>>, String>,
    truths: Vec<Result<Arc<ImageU8>, String>>,
}

impl DecodedTrial {
    pub(super) fn new(trial: Trial, targets: &TargetImages, digests: &ImageDigests) -> Self {
        let context = trial.context().iter().map(|view| view.image().map_err(|error| error.to_string())).collect();
        let truth = |position| match targets.get(position) {
            Some(image) => image.map_err(|error| format!("the ground-truth image: {error}")),
            None => Err("no ground-truth image".to_owned()),
        };
        let truths = (0..trial.targets().len()).map(truth).collect();
        let data_hash = trial.data_hash(targets, digests).to_string();
        Self { trial, data_hash, context, truths }
    }

    /// How many targets can be scored, and why not all: images that cannot be decoded.
    pub(super) fn scorable(&self) -> (usize, Option<String>) {
        if let Err(why) = &self.context {
            return (0, Some(format!("a context image: {why}")));
        }
        let decoded = self.truths.iter().filter(|truth| truth.is_ok()).count();
        (decoded, self.truths.iter().find_map(|truth| truth.as_ref().err().cloned()))
    }
}

impl Evaluation<'_> {
    /// The rows of a trial, also if it fails. Only a file that cannot be written, of the store or for the method, is an error.
    pub(super) fn rows(
        &self,
        key: TrialKey,
        input_hash: Option<String>,
        decoded: &DecodedTrial,
        method: &dyn Method,
    ) -> Result<(TrialRow, Vec<TargetRow>), EvalError> {
        let trial = &decoded.trial;
        let unscored = trial.targets().iter().enumerate().map(|(position, target)| {
            let truth_hash =
                decoded.truths.get(position).and_then(|truth| truth.as_ref().ok()).map(|t| hash_of_bytes(t));
            TargetRow { truth_hash, ..unscored_row(&key, trial, target, position) }
        });
        if let Some(store) = self.images.all() {
            write_inputs(store, &key, decoded)?;
        }
        let record = method.record();
        let mut result = TrialResult { input_hash, rows: unscored.collect(), ..TrialResult::default() };
        // A panic in a method fails this trial only.
        let outcome = catch_unwind(AssertUnwindSafe(|| {
            self.predict_and_score(&key, &mut result, decoded, method, record.record_kind())
        }));
        let error = match outcome {
            Ok(Ok(())) => None,
            Ok(Err(Failure::Method(MethodError::Io(error)))) => return Err(error.into()),
            Ok(Err(Failure::Method(error))) => Some(error),
            Ok(Err(Failure::Store(error))) => return Err(error),
            Err(panic) => Some(MethodError::Failed(panicked(panic.as_ref()))),
        };
        if let Some(error) = &error {
            let unfinished = result.rows.iter_mut().filter(|row| row.render_hash.is_none() && row.detail.is_none());
            unfinished.for_each(|row| row.detail = Some(error.to_string()));
        }
        Ok(result.into_rows(key, decoded, &record, error))
    }

    fn predict_and_score(
        &self,
        key: &TrialKey,
        result: &mut TrialResult,
        decoded: &DecodedTrial,
        method: &dyn Method,
        kind: RecordKind,
    ) -> Result<(), Failure> {
        let context = decoded.context.as_ref();
        let images = context.map_err(|detail| MethodError::Failed(format!("a context image: {detail}")))?;
        let TrialKey { preset, method: name, scene, entry } = key;
        tracing::debug!(preset, method = name, scene, entry, views = images.len(), "predicting");
        let rendered = self.preset.rendered_for(method.setting());
        let prediction = method.predict(TrialInput { preset: &rendered, trial: &decoded.trial, images })?;
        let prediction = prediction.as_ref();
        tracing::debug!(preset, method = name, scene, entry, targets = result.rows.len(), "rendering and scoring");
        result.cost = prediction.cost();
        let rows = result.rows.clone();
        let positions: Vec<usize> = (0..rows.len()).collect();
        let batch = |targets: &[usize]| self.score_batch(prediction, targets, &rows, decoded, kind.is_from_outside());
        // All batches first, so that the error of the first one is reported whatever the number of threads.
        let batches: Vec<Result<Vec<ScoredTarget>, Failure>> = positions.par_chunks(BATCH).map(batch).collect();
        let batches = batches.into_iter().collect::<Result<Vec<_>, _>>()?;
        result.rows.clear();
        for ScoredTarget { row, drawn, effects, suspicion, pair } in batches.into_iter().flatten() {
            result.rows.push(row);
            result.drawn.extend(drawn);
            if let Some(suspicion) = suspicion {
                *result.suspicious.entry(suspicion).or_default() += 1;
            }
            result.effects.extend(effects);
            result.pairs.extend(pair);
        }
        if let Some(store) = self.images.chosen(key, &result.rows, self.preset.metrics.psnr) {
            write_inputs(store, key, decoded)?;
            result.cost.notes.extend(write_renders(store, &result.rows, prediction)?);
        }
        Ok(())
    }

    /// Renders and scores some targets; only the rows are kept, so that few renders are in memory at once.
    #[expect(clippy::expect_used, reason = "positions are those of the rows, and every target has a row and a truth")]
    fn score_batch(
        &self,
        prediction: &dyn Prediction,
        targets: &[usize],
        rows: &[TargetRow],
        decoded: &DecodedTrial,
        is_checked: bool,
    ) -> Result<Vec<ScoredTarget>, Failure> {
        let mut scored = Vec::with_capacity(targets.len());
        for (position, rendered) in targets.iter().zip(render_all(prediction, targets)?) {
            let row = rows.get(*position).cloned().expect("a row for each target");
            let truth = decoded.truths.get(*position).expect("a truth or its error for each target");
            scored.push(self.score(row, rendered, truth, is_checked)?);
        }
        Ok(scored)
    }

    fn score(
        &self,
        mut row: TargetRow,
        rendered: Result<Rendered, String>,
        truth: &Result<Arc<ImageU8>, String>,
        is_checked: bool,
    ) -> Result<ScoredTarget, EvalError> {
        let Rendered { image, drawn, effects } = match rendered {
            Ok(rendered) => rendered,
            Err(detail) => {
                row.detail = Some(detail);
                return Ok(ScoredTarget { row, drawn: None, effects: Vec::new(), suspicion: None, pair: None });
            }
        };
        match truth {
            Ok(truth) => compare(&mut row, self.suite, &image, truth),
            Err(detail) => row.detail = Some(detail.clone()),
        }
        let scored = truth.as_ref().ok().filter(|_| row.status == TargetStatus::Scored);
        let suspicion = scored.and_then(|truth| SuspiciousRender::of(&image, drawn, truth));
        let pair = scored.filter(|_| is_checked).map(|truth| RenderAndTruth::of(&image, truth, row.leaked));
        if let Some(store) = self.images.all() {
            images::write_render(store, &row, &image)?;
        }
        Ok(ScoredTarget { row, drawn, effects, suspicion, pair })
    }
}

/// Why a trial could not be evaluated.
#[derive(Debug, Error)]
enum Failure {
    /// The method failed, which is recorded in the trial's rows.
    #[error(transparent)]
    Method(#[from] MethodError),
    /// The store cannot be written, which ends the run.
    #[error(transparent)]
    Store(#[from] EvalError),
}

/// One outcome for each target; an error if the method returns another number of them.
fn render_all(prediction: &dyn Prediction, targets: &[usize]) -> Result<Vec<Result<Rendered, String>>, MethodError> {
    let rendered = prediction.render(targets);
    if rendered.len() == targets.len() {
        return Ok(rendered);
    }
    let (expected, found) = (targets.len(), rendered.len());
    Err(MethodError::Failed(format!("expected an image for each of {expected} targets, the method returned {found}")))
}

/// Stores ground-truth and context images, which all methods share.
fn write_inputs(store: &Path, key: &TrialKey, decoded: &DecodedTrial) -> Result<(), EvalError> {
    let truths = decoded.trial.targets().iter().map(|target| target.frame).zip(&decoded.truths);
    let truths = truths.filter_map(|(frame, truth)| Some((TRUTH, frame, truth.as_ref().ok()?)));
    let context = decoded.trial.context().iter().zip(decoded.context.iter().flatten());
    let context = context.map(|(view, image)| (CONTEXT, view.frame, image));
    for (method, frame, image) in truths.chain(context) {
        images::write_image(store, &key.of_method(method), frame as u64, image)?;
    }
    Ok(())
}

/// Renders again and stores the renders: whether they are needed is known only after the first renders are dropped. Those that are
/// not the scored ones, or fail this time, are left out and counted in a note, with the first reason: the trial has its scores.
fn write_renders(store: &Path, rows: &[TargetRow], prediction: &dyn Prediction) -> Result<Option<String>, EvalError> {
    const OTHER: &str = "rendered again, it is not the image that was scored";
    let positions: Vec<usize> = (0..rows.len()).collect();
    let (mut lost, mut first_reason) = (0_usize, None);
    for batch in positions.chunks(BATCH) {
        let rendered = match catch_unwind(AssertUnwindSafe(|| render_all(prediction, batch))) {
            Ok(Ok(rendered)) => rendered,
            Ok(Err(error)) => batch.iter().map(|_| Err(error.to_string())).collect(),
            Err(panic) => batch.iter().map(|_| Err(panicked(panic.as_ref()))).collect(),
        };
        for (row, rendered) in batch.iter().filter_map(|position| rows.get(*position)).zip(rendered) {
            let is_same = |image: &Image| row.render_hash.as_ref().is_none_or(|scored| *scored == hash_of(image));
            let reason = match rendered {
                Ok(Rendered { image, .. }) if is_same(&image) => {
                    images::write_render(store, row, &image)?;
                    continue;
                }
                Ok(_) => OTHER.to_owned(),
                Err(reason) => reason,
            };
            if row.render_hash.is_some() {
                lost += 1;
                first_reason.get_or_insert(reason);
            }
        }
    }
    let of = rows.len();
    Ok(first_reason.map(|reason| format!("the images of {lost} of {of} targets are not kept: {reason}")))
}

fn panicked(panic: &(dyn Any + Send)) -> String {
    format!("the method panicked: {}", panic_message(panic).unwrap_or("no message"))
}

/// A rendered and scored target.
struct ScoredTarget {
    row: TargetRow,
    drawn: Option<u64>,
    effects: Vec<&'static str>,
    suspicion: Option<SuspiciousRender>,
    /// Of a method whose images may be other ones than it meant.
    pair: Option<RenderAndTruth>,
}

/// Results of a trial so far.
#[derive(Default)]
struct TrialResult {
    input_hash: Option<String>,
    rows: Vec<TargetRow>,
    cost: Cost,
    drawn: Vec<u64>,
    effects: BTreeSet<&'static str>,
    /// Number of suspicious renders of each kind.
    suspicious: BTreeMap<SuspiciousRender, usize>,
    pairs: Vec<RenderAndTruth>,
}

impl TrialResult {
    fn into_rows(
        self,
        key: TrialKey,
        decoded: &DecodedTrial,
        record: &MethodRecord,
        error: Option<MethodError>,
    ) -> (TrialRow, Vec<TargetRow>) {
        let Self { input_hash, rows, cost, drawn, effects, suspicious, pairs } = self;
        let trial = &decoded.trial;
        let failed = rows.iter().filter(|row| row.status == TargetStatus::Failed).count();
        let first = rows.iter().find_map(|row| row.detail.clone().filter(|_| row.status == TargetStatus::Failed));
        let of_targets = || first.map(|first| format!("{failed} of {} targets failed: {first}", rows.len()));
        let (status, detail) = match error {
            Some(MethodError::NotApplicable(why)) => (TrialStatus::NotApplicable, Some(why)),
            Some(error) => (TrialStatus::Failed, Some(error.to_string())),
            None if failed == 0 => (TrialStatus::Done, None),
            None if failed == rows.len() => (TrialStatus::Failed, of_targets()),
            None => (TrialStatus::Partial, of_targets()),
        };
        let size = trial.targets().first().map(|target| target.size);
        let size = size.or_else(|| trial.context().first().map(|view| view.size));
        // A trial without any view has no size.
        let (width, height) = size.map_or((0, 0), |size| (size.width, size.height));
        let fallbacks =
            trial.normalisation().fallbacks.iter().map(|fallback| format!("pose normalisation: {fallback}"));
        let mistake = image_mistakes::note(&pairs, &rows, record.record_kind(), !suspicious.is_empty());
        let suspicious = suspicious::notes(&suspicious, rows.len(), cost.gaussians);
        let (context_psnr, exact) = match cost.context_psnr {
            Some(psnr) if !psnr.is_finite() => (None, Some(format!("the PSNR on the context views is {psnr}"))),
            psnr => (psnr, None),
        };
        let row = TrialRow {
            key,
            trial_hash: trial.hash().to_string(),
            pose_hash: trial.pose_hash().to_string(),
            data_hash: Some(decoded.data_hash.clone()),
            input_hash,
            status,
            detail,
            context: trial.context().iter().map(|view| view.frame as u64).collect(),
            context_hashes: decoded.context.iter().flatten().map(|image| hash_of_bytes(image)).collect(),
            targets: super::group_run::to_u32(rows.len()),
            overlap: trial.entry().overlap.as_ref().map(|overlap| overlap.value),
            width,
            height,
            initial_tokens: cost.initial_tokens,
            final_tokens: cost.final_tokens,
            gaussians: cost.gaussians,
            gaussians_drawn: mean(drawn.iter().map(|count| *count as f64)),
            context_psnr,
            peak_bytes: cost.peak_bytes,
            network_adapter: record.network_adapter.as_ref().map(ToString::to_string),
            renderer_adapter: record.renderer_adapter.as_ref().map(ToString::to_string),
            effects: effects.into_iter().map(str::to_owned).collect(),
            notes: cost.notes.into_iter().chain(exact).chain(suspicious).chain(mistake).chain(fallbacks).collect(),
        };
        (row, rows)
    }
}
