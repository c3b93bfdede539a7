use std::collections::BTreeMap;

use atsplat_protocol::Aggregation;

use super::selection::{Picked, pick};
use super::summary::of_picked;
use super::{Question, Summary};
use crate::Results;

/// The number at each signed distance from the window of context frames (negative before it, 0 inside, positive after),
/// in increasing order: the mean over scenes of the mean over the scene's targets at that distance.
pub fn by_distance(results: &Results, question: &Question) -> Vec<(i64, Summary)> {
    let mut distances: BTreeMap<i64, Vec<Picked>> = BTreeMap::new();
    for target in pick(results, question) {
        if let Some(distance) = target.distance {
            distances.entry(distance).or_default().push(target);
        }
    }
    distances.into_iter().map(|(distance, picked)| (distance, of_picked(&picked, Aggregation::SceneMeans))).collect()
}
