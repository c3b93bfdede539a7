use std::collections::BTreeMap;

use atsplat_protocol::Aggregation;

use super::selection::{SelectedTarget, select};
use super::summary::of_selected;
use super::{MetricQuery, Summary};
use crate::Results;

/// The number at each signed distance from the window of context frames (negative before it, 0 inside, positive after),
/// in increasing order: the mean over scenes of the mean over the scene's targets at that distance.
pub fn by_distance(results: &Results, query: &MetricQuery) -> Vec<(i64, Summary)> {
    let mut distances: BTreeMap<i64, Vec<SelectedTarget>> = BTreeMap::new();
    for target in select(results, query) {
        if let Some(distance) = target.distance {
            distances.entry(distance).or_default().push(target);
        }
    }
    distances
        .into_iter()
        .map(|(distance, selected)| (distance, of_selected(&selected, Aggregation::SceneMeans)))
        .collect()
}
