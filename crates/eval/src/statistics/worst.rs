use atsplat_metrics::{Direction, definition};

use super::{MetricQuery, SceneMean, scene_means};
use crate::Results;

/// Which way a metric is better; what has no [`atsplat_metrics::Definition`], as errors of depth, is better when smaller.
pub fn direction(metric: &str) -> Direction {
    definition(metric).map_or(Direction::Lower, |definition| definition.direction)
}

/// The scenes with the worst means, the worst first, by the metric's direction; equal ones in order of their keys.
pub fn worst(results: &Results, query: &MetricQuery, count: usize) -> Vec<SceneMean> {
    let mut scenes = scene_means(results, query);
    match direction(query.metric) {
        Direction::Higher => scenes.sort_by(|a, b| a.mean.total_cmp(&b.mean)),
        Direction::Lower => scenes.sort_by(|a, b| b.mean.total_cmp(&a.mean)),
    }
    scenes.truncate(count);
    scenes
}
