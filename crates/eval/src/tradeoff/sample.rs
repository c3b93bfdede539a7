use atsplat_metrics::definition;
use atsplat_protocol::{Aggregation, Preset};
use serde::Serialize;

use super::{Axis, Frontier, Sample, frontier};
use crate::statistics::{Leaked, Question, cost, direction, summary};
use crate::{PresetRecord, Results};

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
pub fn tradeoffs(results: &Results, metrics: &[&str], leaked: Leaked) -> Vec<Tradeoff> {
    let tradeoff = |(preset, metric): (&PresetRecord, &str)| {
        let samples = samples(results, &preset.name, metric, leaked, aggregation(preset));
        let step = quality_step(metric);
        Tradeoff {
            preset: preset.name.clone(),
            protocol: preset.hash.clone(),
            metric: metric.to_owned(),
            unit: definition(metric).map_or_else(String::new, |definition| definition.unit.to_owned()),
            frontiers: [Axis::Seconds, Axis::Gaussians]
                .map(|axis| frontier(&samples, direction(metric), axis, step))
                .into(),
        }
    };
    let presets = results.provenance.presets.iter();
    presets.flat_map(|preset| metrics.iter().map(move |metric| (preset, *metric))).map(tradeoff).collect()
}

/// How the recorded protocol averages; over scenes where the record holds none.
fn aggregation(preset: &PresetRecord) -> Aggregation {
    Preset::from_toml(&preset.toml).map_or(Aggregation::SceneMeans, |preset| preset.aggregation)
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
