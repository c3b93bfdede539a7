//! One trial under one method.

use std::collections::BTreeSet;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;
use std::sync::Arc;

use atsplat_metrics::Suite;
use atsplat_pixels::ImageU8;
use atsplat_protocol::Preset;
use atsplat_protocol::trial::{TargetPictures, Trial};
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
    context: Result<Vec<Arc<ImageU8>>, String>,
    truths: Vec<Result<Arc<ImageU8>, String>>,
}

impl Decoded {
    pub(super) fn new(trial: Trial, targets: &TargetPictures) -> Self {
        let context = trial.context().iter().map(|view| view.picture().map_err(|error| error.to_string())).collect();
        let truth = |position| match targets.get(position) {
            Some(picture) => picture.map_err(|error| format!("the true picture: {error}")),
            None => Err("there is no true picture".to_owned()),
        };
        let truths = (0..trial.targets().len()).map(truth).collect();
        Self { trial, context, truths }
    }
}

impl Evaluation<'_> {
    /// The rows of a trial, whatever happens to it.
    pub(super) fn rows(
        &self,
        key: TrialKey,
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
        let mut made = Made { rows: blanks.collect(), ..Made::default() };
        // A method's bug costs its trial and no other.
        let outcome = catch_unwind(AssertUnwindSafe(|| self.fill(&key, &mut made, decoded, method)));
        let refusal = match outcome {
            Ok(filled) => filled?.err(),
            Err(_panic) => Some(Refusal::Failed("the method panicked".to_owned())),
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
        let chunks: Vec<Vec<Scored>> = positions.par_chunks(TOGETHER).map(chunk).collect::<Result<_, _>>()?;
        made.rows.clear();
        for Scored { row, drawn, effects } in chunks.into_iter().flatten() {
            made.rows.push(row);
            made.drawn.extend(drawn);
            made.effects.extend(effects);
        }
        if let Some(store) = self.pictures.worst(key, &made.rows) {
            keep_given(store, key, decoded)?;
            keep_renders(store, key, decoded, answer.as_ref())?;
        }
        Ok(Ok(()))
    }

    /// Renders and scores some targets. The renders are gone when it is done.
    fn chunk(
        &self,
        answer: &dyn Answer,
        targets: &[usize],
        rows: &[TargetRow],
        decoded: &Decoded,
    ) -> Result<Vec<Scored>, EvalError> {
        let rendered = answer.render(targets);
        let mut scored = Vec::with_capacity(targets.len());
        for (position, rendered) in targets.iter().zip(rendered) {
            let (Some(row), Some(truth)) = (rows.get(*position).cloned(), decoded.truths.get(*position)) else {
                continue;
            };
            scored.push(self.scored(row, rendered, truth)?);
        }
        Ok(scored)
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
fn keep_renders(store: &Path, key: &TrialKey, decoded: &Decoded, answer: &dyn Answer) -> Result<(), EvalError> {
    let targets = decoded.trial.targets();
    let positions: Vec<usize> = (0..targets.len()).collect();
    for together in positions.chunks(TOGETHER) {
        for (position, rendered) in together.iter().zip(answer.render(together)) {
            if let (Some(target), Ok(rendered)) = (targets.get(*position), rendered) {
                pictures::keep(store, key, target.frame as u64, &rendered.image)?;
            }
        }
    }
    Ok(())
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
    rows: Vec<TargetRow>,
    cost: Cost,
    drawn: Vec<u64>,
    effects: BTreeSet<&'static str>,
}

impl Made {
    fn into_rows(self, key: TrialKey, decoded: &Decoded, refusal: Option<Refusal>) -> (TrialRow, Vec<TargetRow>) {
        let Self { rows, cost, drawn, effects } = self;
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
            status,
            detail,
            context: trial.context().iter().map(|view| view.frame as u64).collect(),
            targets: u32::try_from(rows.len()).unwrap_or(u32::MAX),
            overlap: trial.entry().overlap,
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
