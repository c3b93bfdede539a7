use std::collections::BTreeMap;

use atsplat_numeric::{Extremes as _, Tolerance};
use atsplat_splat::Gaussians;
use serde::Serialize;

use super::limit_scene::limit_view;
use super::outputs::{
    context, gaussian_values, image_values, mean_scores, render_values, rendered, resized, score_values, scored,
    targets, view_values,
};
use super::{Outputs, Stage, Stages, View};
use crate::DriftError;

/// Which stages changed since the baseline, and their effects on the numbers.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct Attribution {
    /// Every stage of [`Stage::PROBED`], in pipeline order.
    pub stages: Vec<StageChange>,
    /// Every metric of the probe.
    pub metrics: Vec<MetricEffect>,
}

/// A stage's current output for the baseline's input, compared with the baseline's output.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct StageChange {
    /// Which stage.
    pub stage: Stage,
    /// Whether it differs by more than machines may differ.
    pub verdict: StageVerdict,
    /// Values that differ at all.
    pub differing: u64,
    /// Number of values in the baseline.
    pub values: u64,
    /// Number of values now.
    pub values_now: u64,
    /// Largest difference of a value; NaN if any value is NaN.
    pub largest: f64,
}

/// Whether a stage's output changed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum StageVerdict {
    /// Values were compared and are the same.
    Same,
    /// There were no values to compare.
    Empty,
    /// The output changed.
    Changed,
}

/// The change of a metric from the baseline to now, split by stage.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct MetricEffect {
    /// Id of the metric.
    pub metric: String,
    /// The baseline's mean over the probe's targets.
    pub baseline: f64,
    /// The current mean.
    pub now: f64,
    /// The effect of each stage, in the order of [`Attribution::stages`]; they sum to `now − baseline`.
    pub effects: Vec<f64>,
}

impl Attribution {
    /// The first stage that changed.
    pub fn first(&self) -> Option<Stage> {
        self.stages.iter().find(|stage| stage.verdict == StageVerdict::Changed).map(|stage| stage.stage)
    }
}

/// Attributes changes by replacing stages one at a time. Each stage runs on the baseline's input, which shows whether it
/// changed independently of the others. The probe is also run from each stage's baseline input to the end: replacing the
/// baseline's output of one more stage by the current one changes each metric by that stage's effect.
///
/// With `same_machine`, outputs must be bit-identical. Otherwise the Gaussians of networks may differ by a thousandth of the largest
/// value of their means, quaternions, logarithmic scales, opacity logits and harmonics each, renders by 1e-4 and metrics by a
/// relative 1e-9; decoding and resizing are integer operations and exact everywhere.
///
/// # Errors
/// [`DriftError::Stage`] naming the stage that fails.
pub fn attribute(stages: &dyn Stages, baseline: &Outputs, same_machine: bool) -> Result<Attribution, DriftError> {
    let Outputs { inputs, views, .. } = baseline;
    let decoded = inputs.files.iter().map(|file| stages.decode(file)).collect::<Result<Vec<_>, _>>()?;
    let resized_alone = resized(stages, inputs, &baseline.decoded)?;
    let gaussians = stages.model(context(inputs, views)?)?;
    let renders = rendered(stages, &baseline.gaussians, targets(inputs, views)?)?;
    let scores = scored(stages, &baseline.renders, targets(inputs, views)?)?;
    let alone = [
        vec![image_values(&decoded)],
        vec![view_values(&resized_alone)],
        gaussian_values(&gaussians),
        vec![render_values(&renders, &stages.render(&inputs.limit_scene, &limit_view()?)?)],
        vec![score_values(&scores)],
    ];
    let changes = Stage::PROBED.into_iter().zip(&alone);
    let changes = changes.map(|(stage, now)| change(stage, &baseline.parts(stage), now, same_machine)).collect();

    let from_gaussians = |gaussians: &Gaussians, views: &[View]| {
        let targets = targets(inputs, views)?;
        Ok::<_, DriftError>(mean_scores(&scored(stages, &rendered(stages, gaussians, targets)?, targets)?))
    };
    let from_views = |views: &[View]| from_gaussians(&stages.model(context(inputs, views)?)?, views);
    // Numbers with the current implementation from each stage on; the baseline's numbers last.
    let numbers = [
        from_views(&resized(stages, inputs, &decoded)?)?,
        from_views(&resized_alone)?,
        from_gaussians(&gaussians, views)?,
        mean_scores(&scored(stages, &renders, targets(inputs, views)?)?),
        mean_scores(&scores),
        baseline.mean_scores(),
    ];
    let [now, .., then] = &numbers;
    let effect = |(metric, baseline): (&String, &f64)| {
        let score = |scores: &BTreeMap<String, f64>| scores.get(metric).copied();
        let effects: Option<Vec<f64>> =
            numbers.windows(2).map(|pair| Some(score(pair.first()?)? - score(pair.last()?)?)).collect();
        Some(MetricEffect { metric: metric.clone(), baseline: *baseline, now: score(now)?, effects: effects? })
    };
    Ok(Attribution { stages: changes, metrics: then.iter().filter_map(effect).collect() })
}

/// The parts of a stage's output are values of one kind each.
fn change(stage: Stage, then: &[Vec<f64>], now: &[Vec<f64>], same_machine: bool) -> StageChange {
    let tolerance = |part: &[f64]| match stage {
        _ if same_machine => Tolerance::EXACT,
        Stage::Data | Stage::Decode | Stage::Resize => Tolerance::EXACT,
        Stage::Model => Tolerance::absolute(1e-3 * largest(part.iter().copied())),
        Stage::Renderer => Tolerance::absolute(1e-4),
        Stage::Metric => Tolerance::relative(1e-9),
    };
    let parts = || then.iter().zip(now);
    let is_changed =
        |(then, now): (&Vec<f64>, &Vec<f64>)| tolerance(then).check(now.iter().copied(), then.iter().copied()).is_err();
    let [values, values_now] = [then, now].map(|parts| parts.iter().map(Vec::len).sum::<usize>() as u64);
    let verdict = if parts().any(is_changed) {
        StageVerdict::Changed
    } else if values == 0 {
        StageVerdict::Empty
    } else {
        StageVerdict::Same
    };
    let pairs = || parts().flat_map(|(then, now)| then.iter().zip(now));
    let unpaired: usize = parts().map(|(then, now)| then.len().abs_diff(now.len())).sum();
    StageChange {
        stage,
        verdict,
        differing: (pairs().filter(|(a, b)| !Tolerance::EXACT.accepts(**a, **b)).count() + unpaired) as u64,
        values,
        values_now,
        largest: largest(pairs().map(|(a, b)| a - b)),
    }
}

/// The largest size of a value; 0 without any, NaN if any is NaN.
fn largest(values: impl Iterator<Item = f64>) -> f64 {
    values.fold(0.0, |largest: f64, value| largest.maximum_of(value.abs()))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Means up to 17.5, and harmonics up to 0.5.
    #[test]
    fn each_kind_of_value_has_a_tolerance_of_its_own_size() {
        let then = [vec![-17.5, 3.0], vec![0.5, 0.25]];
        let verdict = |mean: f64, harmonic: f64| {
            let now = [vec![-17.5 + mean, 3.0], vec![0.5, 0.25 + harmonic]];
            change(Stage::Model, &then, &now, false).verdict
        };
        for (mean, harmonic, expected) in [
            (0.017, 0.0004, StageVerdict::Same),
            (0.018, 0.0, StageVerdict::Changed),
            (0.0, -0.0006, StageVerdict::Changed),
            (0.0, 0.017, StageVerdict::Changed),
        ] {
            assert_eq!(verdict(mean, harmonic), expected, "{mean}, {harmonic}");
        }
        let fewer = [vec![-17.5, 3.0], vec![0.5]];
        let found = change(Stage::Model, &then, &fewer, false);
        assert_eq!((found.verdict, found.differing, found.values, found.values_now), (StageVerdict::Changed, 1, 4, 3));
        let exact = change(Stage::Model, &then, &then, true);
        assert_eq!((exact.verdict, exact.differing), (StageVerdict::Same, 0));
        assert_eq!(change(Stage::Metric, &[Vec::new()], &[Vec::new()], true).verdict, StageVerdict::Empty);
    }
}
