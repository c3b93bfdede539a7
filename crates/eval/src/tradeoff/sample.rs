use atsplat_metrics::definition;
use atsplat_protocol::Aggregation;
use serde::Serialize;

use super::{Axis, Frontier, Sample, frontier};
use crate::statistics::{Leaked, Question, cost, direction, summary};
use crate::{EvalError, PresetRecord, Results};

/// Both frontiers of one metric under one protocol.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct Tradeoff {
    /// Name of the preset in the rows.
    pub preset: String,
    /// Its hash.
    pub protocol: String,
    /// Id of the metric.
    pub metric: String,
    /// The metric's unit; empty for plain numbers.
    pub unit: String,
    /// Against seconds, and against Gaussians.
    pub frontiers: Vec<Frontier>,
}

/// Every method of a store as a point, for each protocol and metric.
///
/// # Errors
/// [`EvalError::Preset`].
pub fn tradeoffs(results: &Results, metrics: &[&str], leaked: Leaked) -> Result<Vec<Tradeoff>, EvalError> {
    let tradeoff = |(preset, metric): (&PresetRecord, &str)| {
        let samples = samples(results, &preset.name, metric, leaked, preset.protocol()?.aggregation);
        Ok(of_samples(&preset.name, &preset.hash, metric, &samples))
    };
    let presets = results.provenance.presets.iter();
    presets.flat_map(|preset| metrics.iter().map(move |metric| (preset, *metric))).map(tradeoff).collect()
}

/// The methods of all protocols of a store in one: numbers that answer different questions side by side, as where views or
/// resolution are swept. Labels say the protocol.
///
/// # Errors
/// [`EvalError::Preset`].
pub fn across(results: &Results, metric: &str, leaked: Leaked) -> Result<Tradeoff, EvalError> {
    let of_preset = |preset: &PresetRecord| {
        let samples = samples(results, &preset.name, metric, leaked, preset.protocol()?.aggregation).into_iter();
        let labelled = |sample: Sample| Sample { label: format!("{}, {}", sample.label, preset.name), ..sample };
        Ok(samples.map(labelled).collect::<Vec<_>>())
    };
    let samples: Vec<Vec<Sample>> =
        results.provenance.presets.iter().map(of_preset).collect::<Result<_, EvalError>>()?;
    let samples = samples.concat();
    let hashes: Vec<&str> = results.provenance.presets.iter().map(|preset| preset.hash.as_str()).collect();
    Ok(of_samples("different protocols", &hashes.join(" "), metric, &samples))
}

fn of_samples(preset: &str, protocol: &str, metric: &str, samples: &[Sample]) -> Tradeoff {
    let step = quality_step(metric);
    let along = |axis| frontier(samples, direction(metric), axis, step);
    Tradeoff {
        preset: preset.to_owned(),
        protocol: protocol.to_owned(),
        metric: metric.to_owned(),
        unit: definition(metric).map_or_else(String::new, |definition| definition.unit.to_owned()),
        frontiers: [Axis::Seconds, Axis::Gaussians].map(along).into(),
    }
}

/// The methods of a store under a preset, in the order of the provenance record, each as a sample.
///
/// Seconds are the median of encoding plus the median of rendering one view: what a user waits for the first picture. A
/// method that has only one of both has only that.
pub fn samples(results: &Results, preset: &str, metric: &str, leaked: Leaked, aggregation: Aggregation) -> Vec<Sample> {
    let sample = |method: &str| {
        let question = Question { preset, method, metric, leaked };
        let cost = cost(results, preset, method);
        let secs = match (cost.encode_secs, cost.render_secs) {
            (Some(encode), Some(render)) => Some(encode + render),
            (encode, render) => encode.or(render),
        };
        let quality = summary(results, &question, aggregation).mean;
        (cost.trials > 0).then(|| Sample { label: method.to_owned(), quality, secs, gaussians: cost.gaussians })
    };
    results.provenance.methods.iter().filter_map(|record| sample(&record.name)).collect()
}

/// The step of quality that is priced: 0.1 for decibels, 0.01 for everything else, in the metric's unit.
pub fn quality_step(metric: &str) -> f64 {
    if definition(metric).is_some_and(|definition| definition.unit == "dB") { 0.1 } else { 0.01 }
}
