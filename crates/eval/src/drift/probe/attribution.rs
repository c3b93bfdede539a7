use std::collections::BTreeMap;

use atsplat_numeric::{Extremes as _, Tolerance};
use atsplat_splat::Gaussians;
use serde::Serialize;

use super::outputs::{
    context, mean_scores, of_gaussians, of_pictures, of_renders, of_scores, of_views, rendered, resized, scored,
    targets,
};
use super::sheet::sheet_view;
use super::{Outputs, Stage, Stages, View};
use crate::drift::DriftError;

/// Which stages changed since a baseline, and what each did to the numbers.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct Attribution {
    /// Every stage of [`Stage::PROBED`], in the order of the data.
    pub stages: Vec<StageChange>,
    /// Every metric of the probe.
    pub metrics: Vec<MetricEffect>,
}

/// What a stage makes today of the baseline's own input to it, against what it made then.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct StageChange {
    /// Which stage.
    pub stage: Stage,
    /// Whether more than what machines may differ by is different.
    pub verdict: StageVerdict,
    /// Values that differ at all.
    pub differing: u64,
    /// Values then.
    pub values: u64,
    /// Values today.
    pub values_now: u64,
    /// Largest difference of a value; NaN where one is.
    pub largest: f64,
}

/// Whether a stage does what it did.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum StageVerdict {
    /// Values were compared, and they are the same.
    Same,
    /// There was no value to compare.
    Empty,
    /// Something else comes out.
    Changed,
}

/// A metric's way from the baseline's number to today's, stage by stage.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct MetricEffect {
    /// Id of the metric.
    pub metric: String,
    /// The baseline's mean over the probe's targets.
    pub baseline: f64,
    /// Today's.
    pub now: f64,
    /// What each stage adds, in the order of [`Attribution::stages`]; they sum to `now − baseline`.
    pub effects: Vec<f64>,
}

impl Attribution {
    /// The first stage that changed: where to look.
    pub fn first(&self) -> Option<Stage> {
        self.stages.iter().find(|stage| stage.verdict == StageVerdict::Changed).map(|stage| stage.stage)
    }
}

/// Swaps stages one at a time. Each stage runs on what the baseline fed it, which tells whether it changed whatever the
/// others do. And the probe is run from each stage's baseline input to the end: exchanging yesterday's output of one more
/// stage for today's moves each metric by that stage's effect.
///
/// On the machine type that made the baseline every bit counts; on another one, `same_machine` unset, networks may differ by
/// a thousandth of their largest value, renders by 1e-4, metrics by 1e-9 of themselves. Decoding and resizing are whole
/// numbers and exact anywhere.
///
/// # Errors
/// [`DriftError::Stage`] naming a stage that fails today.
pub fn attribute(stages: &dyn Stages, baseline: &Outputs, same_machine: bool) -> Result<Attribution, DriftError> {
    let Outputs { inputs, views, .. } = baseline;
    let decoded = inputs.files.iter().map(|file| stages.decode(file)).collect::<Result<Vec<_>, _>>()?;
    let resized_alone = resized(stages, inputs, &baseline.decoded)?;
    let gaussians = stages.model(context(inputs, views))?;
    let renders = rendered(stages, &baseline.gaussians, targets(inputs, views))?;
    let scores = scored(stages, &baseline.renders, targets(inputs, views))?;
    let alone = [
        of_pictures(&decoded),
        of_views(&resized_alone),
        of_gaussians(&gaussians),
        of_renders(&renders, &stages.splat(&inputs.sheet, &sheet_view()?)?),
        of_scores(&scores),
    ];
    let changes = Stage::PROBED.into_iter().zip(&alone);
    let changes = changes.map(|(stage, now)| change(stage, &baseline.values(stage), now, same_machine)).collect();

    let from_gaussians = |gaussians: &Gaussians, views: &[View]| {
        let targets = targets(inputs, views);
        Ok::<_, DriftError>(mean_scores(&scored(stages, &rendered(stages, gaussians, targets)?, targets)?))
    };
    let from_views = |views: &[View]| from_gaussians(&stages.model(context(inputs, views))?, views);
    // Today's numbers when today's stages take over at each stage, and yesterday's at the end.
    let numbers = [
        from_views(&resized(stages, inputs, &decoded)?)?,
        from_views(&resized_alone)?,
        from_gaussians(&gaussians, views)?,
        mean_scores(&scored(stages, &renders, targets(inputs, views))?),
        mean_scores(&scores),
        baseline.mean_scores(),
    ];
    let [now, .., then] = &numbers;
    let effect = |(metric, baseline): (&String, &f64)| {
        let of = |scores: &BTreeMap<String, f64>| scores.get(metric).copied();
        let effects: Option<Vec<f64>> =
            numbers.windows(2).map(|pair| Some(of(pair.first()?)? - of(pair.last()?)?)).collect();
        Some(MetricEffect { metric: metric.clone(), baseline: *baseline, now: of(now)?, effects: effects? })
    };
    Ok(Attribution { stages: changes, metrics: then.iter().filter_map(effect).collect() })
}

fn change(stage: Stage, then: &[f64], now: &[f64], same_machine: bool) -> StageChange {
    let size = then.iter().fold(0.0, |size: f64, value| size.maximum_of(value.abs()));
    let tolerance = match stage {
        _ if same_machine => Tolerance::EXACT,
        Stage::Data | Stage::Decode | Stage::Resize => Tolerance::EXACT,
        Stage::Model => Tolerance::absolute(1e-3 * size),
        Stage::Splatter => Tolerance::absolute(1e-4),
        Stage::Metric => Tolerance::relative(1e-9),
    };
    let pairs = || then.iter().zip(now);
    let verdict = if tolerance.check(now.iter().copied(), then.iter().copied()).is_err() {
        StageVerdict::Changed
    } else if then.is_empty() {
        StageVerdict::Empty
    } else {
        StageVerdict::Same
    };
    StageChange {
        stage,
        verdict,
        differing: pairs().filter(|(a, b)| !Tolerance::EXACT.accepts(**a, **b)).count() as u64
            + then.len().abs_diff(now.len()) as u64,
        values: then.len() as u64,
        values_now: now.len() as u64,
        largest: pairs().fold(0.0, |largest: f64, (a, b)| largest.maximum_of((a - b).abs())),
    }
}
