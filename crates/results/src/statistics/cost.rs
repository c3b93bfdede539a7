use std::collections::BTreeSet;

use atsplat_numeric::mean;
use serde::Serialize;

use super::summary::set_hash;
use crate::{Results, TrialRow, TrialStatus};

/// Sizes of one method's predictions under one preset; times are in [`crate::times::times`].
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct Cost {
    /// Trials with results, complete or partial; the fields below are about these.
    pub trials: u64,
    /// Trials in which the method failed.
    pub failed: u64,
    /// Trials that the method does not support.
    pub not_applicable: u64,
    /// Mean number of Gaussians before culling; `None` for methods without Gaussians.
    pub gaussians: Option<f64>,
    /// Smallest number of Gaussians of a trial.
    pub gaussians_min: Option<u64>,
    /// Largest number of Gaussians of a trial.
    pub gaussians_max: Option<u64>,
    /// Mean number of Gaussians that contributed to an image.
    pub gaussians_drawn: Option<f64>,
    /// Mean number of tokens before expansion.
    pub initial_tokens: Option<f64>,
    /// Mean number of tokens after expansion.
    pub final_tokens: Option<f64>,
    /// Largest estimated peak memory in bytes.
    pub peak_bytes: Option<u64>,
    /// Hash of all trials, with results or not; sizes with different hashes are not comparable. `None` without trials.
    #[serde(skip)]
    pub trial_set_hash: Option<u64>,
}

/// The cost of a method under a preset. A number that is not finite, which no store contains, makes its mean NaN or infinite.
pub fn cost(results: &Results, preset: &str, method: &str) -> Cost {
    let all: Vec<&TrialRow> = results.trials_of(preset, method).collect();
    let count = |status: TrialStatus| all.iter().filter(|trial| trial.status == status).count() as u64;
    let has_results = |trial: &&TrialRow| matches!(trial.status, TrialStatus::Done | TrialStatus::Partial);
    let trials: Vec<&TrialRow> = all.iter().copied().filter(has_results).collect();
    let mean_of = |value: &dyn Fn(&TrialRow) -> Option<f64>| mean(trials.iter().filter_map(|trial| value(trial)));
    // What was stated is a mean, and no extreme.
    let gaussians = || trials.iter().filter_map(|trial| trial.gaussians);
    let identities = all.iter().map(|trial| (trial.key.scene.as_str(), trial.key.entry));
    Cost {
        trials: trials.len() as u64,
        failed: count(TrialStatus::Failed),
        not_applicable: count(TrialStatus::NotApplicable),
        gaussians: mean_of(&|trial| results.gaussians_of(trial).map(|count| count as f64)),
        gaussians_min: gaussians().min(),
        gaussians_max: gaussians().max(),
        gaussians_drawn: mean_of(&|trial| trial.gaussians_drawn),
        initial_tokens: mean_of(&|trial| trial.initial_tokens.map(|count| count as f64)),
        final_tokens: mean_of(&|trial| trial.final_tokens.map(|count| count as f64)),
        peak_bytes: trials.iter().filter_map(|trial| trial.peak_bytes).max(),
        trial_set_hash: set_hash(identities.collect::<BTreeSet<_>>()),
    }
}
