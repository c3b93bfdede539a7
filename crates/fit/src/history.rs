//! What happened in a run so far.

use serde::{Deserialize, Serialize};

use crate::density::Changes;
use crate::loss::Terms;
use crate::score::{MeanPsnr, decibels, psnr};
use crate::{Evaluation, MeanScore};

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
        psnr(self.terms.mse).unwrap_or(f64::INFINITY)
    }
}

/// The PSNR of the training views, each in its last step: the Gaussians have changed since. Views whose render was equal to their
/// image are counted and left out.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct LastSteps {
    /// The mean in dB; `None` without any view.
    #[serde(rename = "training-psnr")]
    pub psnr: Option<f64>,
    /// How many views the mean is over.
    #[serde(rename = "training-psnr-views")]
    pub views: usize,
    /// How many views were left out.
    #[serde(rename = "training-identical")]
    pub identical: usize,
}

impl LastSteps {
    /// In words, of this many training views; `None` before the first step.
    pub(crate) fn text(&self, all: usize) -> Option<String> {
        let Self { psnr, views, identical } = *self;
        let left_out =
            if identical == 0 { String::new() } else { format!("; {identical} equal to the photo, left out") };
        let text = || format!("{}, mean over each view's last step, {views} of {all} views{left_out}", decibels(psnr));
        (views + identical > 0).then(text)
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
    /// Views that each evaluation left out. Earlier versions did not write it; they left none out, and their SSIM was that of the loss.
    #[serde(default)]
    identical: Option<Vec<usize>>,
    /// Views that clamping made equal in each evaluation. Earlier versions left them out of the mean PSNR, and did not count them.
    #[serde(default)]
    equal_when_clamped: Option<Vec<usize>>,
}

impl History {
    /// Names of [`Self::arrays`].
    pub(crate) const ARRAYS: [&str; 3] = ["history/losses", "history/scores", "history/training"];

    /// That of a run before its first step.
    pub(crate) fn new(views: usize) -> Self {
        Self { training: vec![None; views], ..Self::default() }
    }

    /// The PSNR of the last step on each training view.
    pub fn last_steps(&self) -> LastSteps {
        let psnrs = self.training.iter().flatten().map(|psnr| psnr.is_finite().then_some(*psnr));
        let MeanPsnr { mean, views, equal } = MeanPsnr::of(psnrs);
        LastSteps { psnr: mean, views, identical: equal }
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

    /// `held_out` makes the hash of the views that were compared, which are the same in every evaluation.
    pub(crate) fn add_evaluation(&mut self, evaluation: Evaluation, held_out: impl FnOnce() -> String) {
        self.evaluations.push(evaluation);
        self.held_out.get_or_insert_with(held_out);
    }

    pub(crate) fn facts(&self) -> HistoryFacts {
        let evaluations = self.evaluations.iter().map(|evaluation| (evaluation.step, evaluation.gaussians)).collect();
        let scores = || self.evaluations.iter().map(|evaluation| evaluation.score);
        HistoryFacts {
            changes: self.changes,
            held_out: self.held_out.clone(),
            evaluations,
            identical: Some(scores().map(|score| score.identical).collect()),
            equal_when_clamped: Some(scores().map(|score| score.equal_when_clamped).collect()),
        }
    }

    /// Arrays of a checkpoint: four numbers for each step, two for each evaluation, one for each training view.
    pub(crate) fn arrays(&self) -> [Vec<f64>; 3] {
        let losses = self.losses.iter().flat_map(|Terms { l1, d_ssim, mse, total }| [*l1, *d_ssim, *mse, *total]);
        // No score and no PSNR of a step is NaN: the loss of a step is finite.
        let scores = self.evaluations.iter().flat_map(|Evaluation { score, .. }| [score.psnr, score.ssim]);
        let scores = scores.map(|score| score.unwrap_or(f64::NAN));
        let training = self.training.iter().map(|psnr| psnr.unwrap_or(f64::NAN));
        [losses.collect(), scores.collect(), training.collect()]
    }

    /// The history of [`Self::facts`] and [`Self::arrays`] after some steps on some views; `None` for other lengths. Evaluations of
    /// earlier versions have no SSIM.
    pub(crate) fn restored(facts: HistoryFacts, arrays: &[Vec<f64>; 3], steps: u64, views: usize) -> Option<Self> {
        let HistoryFacts { changes, held_out, evaluations, identical, equal_when_clamped } = facts;
        let is_earlier = identical.is_none();
        let zeros = || vec![0; evaluations.len()];
        let (identical, equal) = (identical.unwrap_or_else(zeros), equal_when_clamped.unwrap_or_else(zeros));
        let [losses, scores, training] = arrays;
        let ((losses, rest), (scores, no_rest)) = (losses.as_chunks::<4>(), scores.as_chunks::<2>());
        let fits = losses.len() as u64 == steps && scores.len() == evaluations.len() && training.len() == views;
        let are_counted = [&identical, &equal].iter().all(|counts| counts.len() == scores.len());
        if !fits || !are_counted || !rest.is_empty() || !no_rest.is_empty() {
            return None;
        }
        let terms = |[l1, d_ssim, mse, total]: &[f64; 4]| Terms { l1: *l1, d_ssim: *d_ssim, mse: *mse, total: *total };
        let score = |[psnr, ssim]: &[f64; 2], (identical, equal_when_clamped)| MeanScore {
            psnr: psnr.is_finite().then_some(*psnr),
            ssim: (ssim.is_finite() && !is_earlier).then_some(*ssim),
            identical,
            equal_when_clamped,
        };
        let scores = scores.iter().zip(identical.into_iter().zip(equal)).map(|(of, counts)| score(of, counts));
        let evaluations = evaluations.into_iter().zip(scores);
        let evaluations = evaluations.map(|((step, gaussians), score)| Evaluation { step, gaussians, score });
        Some(Self {
            losses: losses.iter().map(terms).collect(),
            evaluations: evaluations.collect(),
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

    /// An exact step, an evaluation without a PSNR, and a view without a step.
    #[test]
    fn a_history_is_restored_to_the_last_bit() {
        let mut history = History::new(3);
        for (step, view, mse) in [(1, 2, 0.1), (2, 0, 0.0)] {
            let terms = Terms { l1: 0.1 + mse, d_ssim: 0.2 + mse, mse, total: 0.3 };
            let changes = Changes { cloned: view, ..Changes::default() };
            history.add_step(&StepRecord { step, view, terms, regularisers: 0.0, gaussians: 5, changes });
        }
        let score = MeanScore { psnr: None, ssim: Some(0.1), identical: 3, equal_when_clamped: 2 };
        history.add_evaluation(Evaluation { step: 2, gaussians: 5, score }, || "views".to_owned());
        assert_eq!(history.changes.cloned, 2);
        let facts = || serde_json::from_str(&serde_json::to_string(&history.facts()).unwrap()).unwrap();
        let arrays = history.arrays();
        let restored = History::restored(facts(), &arrays, 2, 3).unwrap();
        assert!(restored == history && restored.is_of("views") && !restored.is_of("others"), "{restored:?}");
        assert_eq!(History::restored(facts(), &arrays, 3, 3), None, "a step without a loss");
        assert_eq!(History::restored(facts(), &arrays, 2, 2), None, "another number of views");
        let uncounted = HistoryFacts { equal_when_clamped: None, ..facts() };
        let restored = History::restored(uncounted, &arrays, 2, 3).unwrap().evaluations[0].score;
        assert_eq!(restored, MeanScore { equal_when_clamped: 0, ..score });
        let earlier = HistoryFacts { identical: None, equal_when_clamped: None, ..facts() };
        let score = History::restored(earlier, &arrays, 2, 3).unwrap().evaluations[0].score;
        assert_eq!(score, MeanScore::default(), "of the SSIM of an earlier version");
    }

    #[test]
    fn held_out_views_are_hashed_once() {
        let mut history = History::new(1);
        for (step, hash) in [(1, "views"), (2, "hashed again")] {
            let evaluation = Evaluation { step, gaussians: 5, score: MeanScore::default() };
            history.add_evaluation(evaluation, || hash.to_owned());
        }
        assert!(history.is_of("views") && history.evaluations.len() == 2, "{history:?}");
    }

    /// The exact step would make the mean infinite.
    #[test]
    fn an_exact_last_step_is_counted_and_left_out() {
        let mut history = History::new(4);
        assert_eq!(history.last_steps().text(4), None, "before the first step");
        for (step, view, mse) in [(1, 0, 1.0), (2, 3, 0.01), (3, 1, 0.0), (4, 0, 0.0001)] {
            let terms = Terms { mse, ..Terms::default() };
            let changes = Changes::default();
            history.add_step(&StepRecord { step, view, terms, regularisers: 0.0, gaussians: 5, changes });
        }
        let LastSteps { psnr, views, identical } = history.last_steps();
        atsplat_numeric::Tolerance::absolute(1e-9).assert([psnr.unwrap()], [30.0], "the mean of 40 and 20 dB");
        assert_eq!((views, identical), (2, 1));
        let text = "30.00 dB, mean over each view's last step, 2 of 4 views; 1 equal to the photo, left out";
        assert_eq!(history.last_steps().text(4).as_deref(), Some(text));
    }
}
