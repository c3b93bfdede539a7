use std::collections::BTreeMap;

use atsplat_numeric::quantile;
use serde::Serialize;

use crate::{Results, TrialRow, TrialStatus};

/// What one method's answers under one preset took.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct Cost {
    /// Trials that were answered, in full or in part; the rest of this record is about them.
    pub trials: u64,
    /// Trials in which the method made nothing.
    pub failed: u64,
    /// Trials that the method does not answer.
    pub not_applicable: u64,
    /// Mean number of Gaussians, before anything is culled; `None` for methods without.
    pub gaussians: Option<f64>,
    /// Fewest Gaussians of a trial.
    pub gaussians_min: Option<u64>,
    /// Most Gaussians of a trial.
    pub gaussians_max: Option<u64>,
    /// Mean number of Gaussians that reached a picture.
    pub gaussians_drawn: Option<f64>,
    /// Mean number of tokens before expansion.
    pub initial_tokens: Option<f64>,
    /// Mean number of tokens that became Gaussians.
    pub final_tokens: Option<f64>,
    /// Median seconds from context to Gaussians.
    pub encode_secs: Option<f64>,
    /// Their median absolute deviation, unscaled.
    pub encode_mad: Option<f64>,
    /// Median seconds for one target view.
    pub render_secs: Option<f64>,
    /// Their median absolute deviation, unscaled.
    pub render_mad: Option<f64>,
    /// Median seconds for reading and decoding a trial's pictures.
    pub read_secs: Option<f64>,
    /// Median seconds for a trial's metrics.
    pub score_secs: Option<f64>,
    /// Largest estimated peak of memory in bytes.
    pub peak_bytes: Option<u64>,
    /// Median seconds of each stage of the encoding, by name.
    pub stages: BTreeMap<String, f64>,
}

/// The cost of a method under a preset; durations that are not finite or negative count nowhere.
pub fn cost(results: &Results, preset: &str, method: &str) -> Cost {
    let all = results.trials.iter().filter(|trial| trial.key.preset == preset && trial.key.method == method);
    let count = |status: TrialStatus| all.clone().filter(|trial| trial.status == status).count() as u64;
    let answered = |trial: &&TrialRow| matches!(trial.status, TrialStatus::Done | TrialStatus::Partial);
    let trials: Vec<&TrialRow> = all.clone().filter(answered).collect();
    let mean = |of: &dyn Fn(&TrialRow) -> Option<f64>| mean(trials.iter().filter_map(|trial| of(trial)));
    let spread = |of: &dyn Fn(&TrialRow) -> Option<f64>| {
        let pair = median_and_deviation(trials.iter().filter_map(|trial| of(trial)));
        (pair.map(|pair| pair.0), pair.map(|pair| pair.1))
    };
    let ((encode_secs, encode_mad), (render_secs, render_mad)) =
        (spread(&|trial| trial.seconds.encode), spread(&|trial| trial.seconds.render));
    let gaussians = || trials.iter().filter_map(|trial| trial.gaussians);
    let mut stages: BTreeMap<&str, Vec<f64>> = BTreeMap::new();
    for (name, secs) in trials.iter().flat_map(|trial| &trial.seconds.stages) {
        stages.entry(name).or_default().push(*secs);
    }
    let median = |(name, secs): (&str, Vec<f64>)| Some((name.to_owned(), median_and_deviation(secs)?.0));
    Cost {
        trials: trials.len() as u64,
        failed: count(TrialStatus::Failed),
        not_applicable: count(TrialStatus::NotApplicable),
        gaussians: mean(&|trial| trial.gaussians.map(|count| count as f64)),
        gaussians_min: gaussians().min(),
        gaussians_max: gaussians().max(),
        gaussians_drawn: mean(&|trial| trial.gaussians_drawn),
        initial_tokens: mean(&|trial| trial.initial_tokens.map(|count| count as f64)),
        final_tokens: mean(&|trial| trial.final_tokens.map(|count| count as f64)),
        encode_secs,
        encode_mad,
        render_secs,
        render_mad,
        read_secs: spread(&|trial| Some(trial.seconds.read)).0,
        score_secs: spread(&|trial| Some(trial.seconds.score)).0,
        peak_bytes: trials.iter().filter_map(|trial| trial.peak_bytes).max(),
        stages: stages.into_iter().filter_map(median).collect(),
    }
}

/// The median, and the median distance from it (unscaled); values that are not finite or negative are left out.
pub fn median_and_deviation(values: impl IntoIterator<Item = f64>) -> Option<(f64, f64)> {
    let mut values: Vec<f64> = values.into_iter().filter(|value| value.is_finite() && *value >= 0.0).collect();
    values.sort_by(f64::total_cmp);
    let median = quantile(&values, 0.5)?;
    let mut distances: Vec<f64> = values.iter().map(|value| (value - median).abs()).collect();
    distances.sort_by(f64::total_cmp);
    Some((median, quantile(&distances, 0.5)?))
}

fn mean(values: impl Iterator<Item = f64>) -> Option<f64> {
    let (sum, count) = values.filter(|value| value.is_finite()).fold((0.0, 0u64), |(s, n), value| (s + value, n + 1));
    (count > 0).then(|| sum / count as f64)
}
