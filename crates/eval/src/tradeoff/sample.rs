use atsplat_metrics::definition;
use atsplat_protocol::Aggregation;

use super::Sample;
use crate::Results;
use crate::statistics::{Leaked, Question, cost, summary};

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
