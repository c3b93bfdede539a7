//! One trial under one method.

use std::any::Any;
use std::collections::BTreeSet;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;
use std::sync::Arc;

use atsplat_metrics::Suite;
use atsplat_pixels::ImageU8;
use atsplat_protocol::Preset;
use atsplat_protocol::trial::{PictureDigests, TargetPictures, Trial};
use rayon::prelude::*;

use super::pictures::{self, CONTEXT, Keeping, TRUTH};
use super::scored::{blank, compare, hash_of_bytes};
use crate::method::{Answer, Cost, Method, Question, Refusal, Rendered};
use crate::{EvalError, TargetRow, TargetStatus, TrialKey, TrialRow, TrialStatus};

/// Targets that are rendered together.
const TOGETHER: usize = 4;

/// How trials are evaluated.
#[derive(Clone, Copy, Debug)]
pub(super) struct Evaluation<'a> {
    pub(super) preset: &'a Preset,
    pub(super) suite: &'a Suite,
    /// Which pictures are kept.
    pub(super) pictures: Keeping<'a>,
}

/// A trial with all of its pictures.
pub(super) struct Decoded {
    pub(super) trial: Trial,
    /// Of the bytes that were decoded, as [`Trial::data_hash`].
    pub(super) data_hash: String,
    context: Result<Vec<Arc<ImageU8>>, String>,
    truths: Vec<Result<Arc<ImageU8>, String>>,
}

impl Decoded {
    pub(super) fn new(trial: Trial, targets: &TargetPictures, digests: &PictureDigests) -> Self {
        let context = trial.context().iter().map(|view| view.picture().map_err(|error| error.to_string())).collect();
        let truth = |position| match targets.get(position) {
            Some(picture) => picture.map_err(|error| format!("the true picture: {error}")),
            None => Err("there is no true picture".to_owned()),
        };
        let truths = (0..trial.targets().len()).map(truth).collect();
        let data_hash = trial.data_hash(targets, digests).to_string();
        Self { trial, data_hash, context, truths }
    }
}

impl Evaluation<'_> {
    /// The rows of a trial, whatever happens to it.
    pub(super) fn rows(
        &self,
        key: TrialKey,
        input_hash: Option<String>,
        decoded: &Decoded,
        method: &dyn Method,
    ) -> Result<(TrialRow, Vec<TargetRow>), EvalError> {
        let trial = &decoded.trial;
        let blanks = trial.targets().iter().enumerate().map(|(at, target)| {
            let truth_hash = decoded.truths.get(at).and_then(|truth| truth.as_ref().ok()).map(|t| hash_of_bytes(t));
            TargetRow { truth_hash, ..blank(&key, trial, target, at) }
        });
        if let Some(store) = self.pictures.all() {
            keep_given(store, &key, decoded)?;
        }
        let mut made = Made { input_hash, rows: blanks.collect(), ..Made::default() };
        // A method's bug costs its trial and no other.
        let outcome = catch_unwind(AssertUnwindSafe(|| self.fill(&key, &mut made, decoded, method)));
        let refusal = match outcome {
            Ok(filled) => filled?.err(),
            Err(panic) => Some(Refusal::Failed(format!("the method panicked: {}", text_of(panic.as_ref())))),
        };
        if let Some(refusal) = &refusal {
            let unfilled = made.rows.iter_mut().filter(|row| row.render_hash.is_none() && row.detail.is_none());
            unfilled.for_each(|row| row.detail = Some(refusal.to_string()));
        }
        Ok(made.into_rows(key, decoded, refusal))
    }

    fn fill(
        &self,
        key: &TrialKey,
        made: &mut Made,
        decoded: &Decoded,
        method: &dyn Method,
    ) -> Result<Result<(), Refusal>, EvalError> {
        let pictures = match &decoded.context {
            Ok(pictures) => pictures,
            Err(detail) => return Ok(Err(Refusal::Failed(format!("a context picture: {detail}")))),
        };
        let answer = match method.begin(Question { preset: self.preset, trial: &decoded.trial, pictures }) {
            Ok(answer) => answer,
            Err(refusal) => return Ok(Err(refusal)),
        };
        made.cost = answer.cost().clone();
        let rows = made.rows.clone();
        let positions: Vec<usize> = (0..rows.len()).collect();
        let chunk = |targets: &[usize]| self.chunk(answer.as_ref(), targets, &rows, decoded);
        let chunks: Vec<Result<Vec<Scored>, Refusal>> =
            positions.par_chunks(TOGETHER).map(chunk).collect::<Result<_, _>>()?;
        let chunks = match chunks.into_iter().collect::<Result<Vec<_>, Refusal>>() {
            Ok(chunks) => chunks,
            Err(refusal) => return Ok(Err(refusal)),
        };
        made.rows.clear();
        for Scored { row, drawn, effects } in chunks.into_iter().flatten() {
            made.rows.push(row);
            made.drawn.extend(drawn);
            made.effects.extend(effects);
        }
        if let Some(store) = self.pictures.worst(key, &made.rows) {
            keep_given(store, key, decoded)?;
            return keep_renders(store, key, decoded, answer.as_ref());
        }
        Ok(Ok(()))
    }

    /// Renders and scores some targets. The renders are gone when it is done.
    #[expect(clippy::expect_used, reason = "positions are those of the rows, and every target has a row and a truth")]
    fn chunk(
        &self,
        answer: &dyn Answer,
        targets: &[usize],
        rows: &[TargetRow],
        decoded: &Decoded,
    ) -> Result<Result<Vec<Scored>, Refusal>, EvalError> {
        let rendered = match render_all(answer, targets) {
            Ok(rendered) => rendered,
            Err(refusal) => return Ok(Err(refusal)),
        };
        let mut scored = Vec::with_capacity(targets.len());
        for (position, rendered) in targets.iter().zip(rendered) {
            let row = rows.get(*position).cloned().expect("a row for each target");
            let truth = decoded.truths.get(*position).expect("a truth or its error for each target");
            scored.push(self.scored(row, rendered, truth)?);
        }
        Ok(Ok(scored))
    }

    fn scored(
        &self,
        mut row: TargetRow,
        rendered: Result<Rendered, String>,
        truth: &Result<Arc<ImageU8>, String>,
    ) -> Result<Scored, EvalError> {
        let Rendered { image, drawn, effects } = match rendered {
            Ok(rendered) => rendered,
            Err(detail) => {
                row.detail = Some(detail);
                return Ok(Scored { row, drawn: None, effects: Vec::new() });
            }
        };
        match truth {
            Ok(truth) => compare(&mut row, self.suite, &image, truth),
            Err(detail) => row.detail = Some(detail.clone()),
        }
        if let Some(store) = self.pictures.all() {
            pictures::keep(store, &row.key, row.frame, &image)?;
        }
        Ok(Scored { row, drawn, effects })
    }
}

/// What a panic said.
fn text_of(panic: &(dyn Any + Send)) -> &str {
    let text = panic.downcast_ref::<String>().map(String::as_str);
    text.or_else(|| panic.downcast_ref::<&str>().copied()).unwrap_or("without a text")
}

/// As many pictures as targets, or why not.
fn render_all(answer: &dyn Answer, targets: &[usize]) -> Result<Vec<Result<Rendered, String>>, Refusal> {
    let rendered = answer.render(targets);
    if rendered.len() == targets.len() {
        return Ok(rendered);
    }
    Err(Refusal::Failed(format!(
        "expected a picture for each of {} targets, the method gave {}",
        targets.len(),
        rendered.len()
    )))
}

/// Keeps what methods have in common: true and context pictures.
fn keep_given(store: &Path, key: &TrialKey, decoded: &Decoded) -> Result<(), EvalError> {
    let truths = decoded.trial.targets().iter().map(|target| target.frame).zip(&decoded.truths);
    let truths = truths.filter_map(|(frame, truth)| Some((TRUTH, frame, truth.as_ref().ok()?)));
    let context = decoded.trial.context().iter().zip(decoded.context.iter().flatten());
    let context = context.map(|(view, picture)| (CONTEXT, view.frame, picture));
    for (method, frame, picture) in truths.chain(context) {
        pictures::keep_bytes(store, &pictures::common(key, method), frame as u64, picture)?;
    }
    Ok(())
}

/// Renders once more, since a trial's score is known after its renders are gone, and keeps them.
fn keep_renders(
    store: &Path,
    key: &TrialKey,
    decoded: &Decoded,
    answer: &dyn Answer,
) -> Result<Result<(), Refusal>, EvalError> {
    let targets = decoded.trial.targets();
    let positions: Vec<usize> = (0..targets.len()).collect();
    for together in positions.chunks(TOGETHER) {
        let rendered = match render_all(answer, together) {
            Ok(rendered) => rendered,
            Err(refusal) => return Ok(Err(refusal)),
        };
        for (position, rendered) in together.iter().zip(rendered) {
            if let (Some(target), Ok(rendered)) = (targets.get(*position), rendered) {
                pictures::keep(store, key, target.frame as u64, &rendered.image)?;
            }
        }
    }
    Ok(Ok(()))
}

/// A target that was rendered and scored.
struct Scored {
    row: TargetRow,
    drawn: Option<u64>,
    effects: Vec<&'static str>,
}

/// A trial on its way to its rows.
#[derive(Default)]
struct Made {
    input_hash: Option<String>,
    rows: Vec<TargetRow>,
    cost: Cost,
    drawn: Vec<u64>,
    effects: BTreeSet<&'static str>,
}

impl Made {
    fn into_rows(self, key: TrialKey, decoded: &Decoded, refusal: Option<Refusal>) -> (TrialRow, Vec<TargetRow>) {
        let Self { input_hash, rows, cost, drawn, effects } = self;
        let trial = &decoded.trial;
        let failed = rows.iter().filter(|row| row.status == TargetStatus::Failed).count();
        let first = rows.iter().find_map(|row| row.detail.clone().filter(|_| row.status == TargetStatus::Failed));
        let of_targets = || first.map(|first| format!("{failed} of {} targets failed: {first}", rows.len()));
        let (status, detail) = match refusal {
            Some(Refusal::NotApplicable(why)) => (TrialStatus::NotApplicable, Some(why)),
            Some(Refusal::Failed(why)) => (TrialStatus::Failed, Some(why)),
            None if failed == 0 => (TrialStatus::Done, None),
            None if failed == rows.len() => (TrialStatus::Failed, of_targets()),
            None => (TrialStatus::Partial, of_targets()),
        };
        let size = trial.targets().first().map(|target| target.size);
        let size = size.or_else(|| trial.context().first().map(|view| view.size));
        let fallbacks =
            trial.normalisation().fallbacks.iter().map(|fallback| format!("pose normalisation: {fallback:?}"));
        let row = TrialRow {
            key,
            trial_hash: trial.hash().to_string(),
            pose_hash: trial.pose_hash().to_string(),
            data_hash: Some(decoded.data_hash.clone()),
            input_hash,
            status,
            detail,
            context: trial.context().iter().map(|view| view.frame as u64).collect(),
            context_hashes: decoded.context.iter().flatten().map(|picture| hash_of_bytes(picture)).collect(),
            targets: super::walk::number(rows.len()),
            overlap: trial.entry().overlap.as_ref().map(|overlap| overlap.value),
            width: size.map(|size| size.width).unwrap_or_default(),
            height: size.map(|size| size.height).unwrap_or_default(),
            initial_tokens: cost.initial_tokens,
            final_tokens: cost.final_tokens,
            gaussians: cost.gaussians,
            gaussians_drawn: mean(&drawn),
            peak_bytes: cost.peak_bytes,
            effects: effects.into_iter().map(str::to_owned).collect(),
            notes: cost.notes.into_iter().chain(fallbacks).collect(),
        };
        (row, rows)
    }
}

fn mean(counts: &[u64]) -> Option<f64> {
    (!counts.is_empty()).then(|| counts.iter().sum::<u64>() as f64 / counts.len() as f64)
}
