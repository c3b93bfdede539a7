//! What happened in a run so far.

use atsplat_numeric::mean;
use serde::{Deserialize, Serialize};

use crate::Evaluation;
use crate::density::Changes;
use crate::loss::Terms;
use crate::score::psnr;

/// One step.
#[derive(Clone, Debug, PartialEq)]
pub struct StepRecord {
    /// Counted from 1.
    pub step: u64,
    /// Position of the training view.
    pub view: usize,
    /// Terms of the loss.
    pub terms: Terms,
    /// Sum of the strategy's regularisers, which the total of the terms does not include.
    pub regularisers: f64,
    /// Gaussians after the step.
    pub gaussians: usize,
    /// What density control changed.
    pub changes: Changes,
}

impl StepRecord {
    /// PSNR of the training image, in dB; infinite for an exact one.
    pub fn psnr(&self) -> f64 {
        psnr(self.terms.mse)
    }
}

/// What happened in a run so far. Checkpoints contain it, so that the record of a resumed run is that of an uninterrupted one.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct History {
    /// The loss of each step.
    pub losses: Vec<Terms>,
    /// Comparisons with the held-out views, see [`crate::Fit::evaluate`].
    pub evaluations: Vec<Evaluation>,
    /// What density control changed last.
    pub changes: Changes,
    /// PSNR of the last step on each training view, in dB.
    training: Vec<Option<f64>>,
    /// Hash of the views of the evaluations.
    held_out: Option<String>,
}

/// What a checkpoint's metadata says of a history; the numbers are in tensors, as JSON has no infinity.
#[derive(Debug, Serialize, Deserialize)]
pub(crate) struct HistoryFacts {
    changes: Changes,
    held_out: Option<String>,
    /// Step and number of Gaussians of each evaluation.
    evaluations: Vec<(u64, usize)>,
}

impl History {
    /// Names of [`Self::arrays`].
    pub(crate) const ARRAYS: [&str; 3] = ["history/losses", "history/scores", "history/training"];

    /// That of a run before its first step.
    pub(crate) fn new(views: usize) -> Self {
        Self { training: vec![None; views], ..Self::default() }
    }

    /// Mean PSNR of the last step on each training view, in dB; `None` before the first step.
    pub fn training_psnr(&self) -> Option<f64> {
        mean(self.training.iter().flatten().copied())
    }

    pub(crate) fn add_step(&mut self, record: &StepRecord) {
        self.losses.push(record.terms);
        if let Some(slot) = self.training.get_mut(record.view) {
            *slot = Some(record.psnr());
        }
        if record.changes != Changes::default() {
            self.changes = record.changes;
        }
    }

    /// `held_out` is the hash of the views that were compared.
    pub(crate) fn add_evaluation(&mut self, evaluation: Evaluation, held_out: String) {
        self.evaluations.push(evaluation);
        self.held_out = Some(held_out);
    }

    pub(crate) fn facts(&self) -> HistoryFacts {
        let evaluations = self.evaluations.iter().map(|evaluation| (evaluation.step, evaluation.gaussians)).collect();
        HistoryFacts { changes: self.changes, held_out: self.held_out.clone(), evaluations }
    }

    /// Arrays of a checkpoint: four numbers for each step, two for each evaluation, one for each training view.
    pub(crate) fn arrays(&self) -> [Vec<f64>; 3] {
        let losses = self.losses.iter().flat_map(|Terms { l1, d_ssim, mse, total }| [*l1, *d_ssim, *mse, *total]);
        let scores = self.evaluations.iter().flat_map(|evaluation| [evaluation.psnr, evaluation.ssim]);
        // The PSNR of a step is never NaN, because its loss is finite.
        let training = self.training.iter().map(|psnr| psnr.unwrap_or(f64::NAN));
        [losses.collect(), scores.collect(), training.collect()]
    }

    /// The history of [`Self::facts`] and [`Self::arrays`] after some steps on some views; `None` for other lengths.
    pub(crate) fn restored(facts: HistoryFacts, arrays: &[Vec<f64>; 3], steps: u64, views: usize) -> Option<Self> {
        let HistoryFacts { changes, held_out, evaluations } = facts;
        let [losses, scores, training] = arrays;
        let ((losses, rest), (scores, no_rest)) = (losses.as_chunks::<4>(), scores.as_chunks::<2>());
        let fits = losses.len() as u64 == steps && scores.len() == evaluations.len() && training.len() == views;
        if !fits || !rest.is_empty() || !no_rest.is_empty() {
            return None;
        }
        let terms = |[l1, d_ssim, mse, total]: &[f64; 4]| Terms { l1: *l1, d_ssim: *d_ssim, mse: *mse, total: *total };
        let evaluation = |((step, gaussians), [psnr, ssim]): ((u64, usize), &[f64; 2])| Evaluation {
            step,
            gaussians,
            psnr: *psnr,
            ssim: *ssim,
        };
        Some(Self {
            losses: losses.iter().map(terms).collect(),
            evaluations: evaluations.into_iter().zip(scores).map(evaluation).collect(),
            changes,
            training: training.iter().map(|psnr| (!psnr.is_nan()).then_some(*psnr)).collect(),
            held_out,
        })
    }

    /// Whether all evaluations so far are of the views with this hash.
    pub(crate) fn is_of(&self, held_out: &str) -> bool {
        self.held_out.as_deref().is_none_or(|known| known == held_out)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Infinite scores, and a view without a step.
    #[test]
    fn a_history_is_restored_to_the_last_bit() {
        let mut history = History::new(3);
        for (step, view, mse) in [(1, 2, 0.1), (2, 0, 0.0)] {
            let terms = Terms { l1: 0.1 + mse, d_ssim: 0.2 + mse, mse, total: 0.3 };
            let changes = Changes { cloned: view, ..Changes::default() };
            history.add_step(&StepRecord { step, view, terms, regularisers: 0.0, gaussians: 5, changes });
        }
        let evaluation = Evaluation { step: 2, gaussians: 5, psnr: f64::INFINITY, ssim: 0.1 };
        history.add_evaluation(evaluation, "views".to_owned());
        assert_eq!((history.training_psnr(), history.changes.cloned), (Some(f64::INFINITY), 2));
        let facts = || serde_json::from_str(&serde_json::to_string(&history.facts()).unwrap()).unwrap();
        let arrays = history.arrays();
        let restored = History::restored(facts(), &arrays, 2, 3).unwrap();
        assert!(restored == history && restored.is_of("views") && !restored.is_of("others"), "{restored:?}");
        assert_eq!(History::restored(facts(), &arrays, 3, 3), None, "a step without a loss");
        assert_eq!(History::restored(facts(), &arrays, 2, 2), None, "another number of views");
    }
}
