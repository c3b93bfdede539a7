use std::collections::{BTreeMap, BTreeSet};

use atsplat_metrics::{Direction, definition};
use atsplat_protocol::Aggregation;
use serde::Serialize;

use super::MetricQuery;
use super::selection::{ImageKey, Outcome, SelectedTarget, select};
use crate::Results;

/// The mean score of one scene.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct SceneMean {
    /// Key of the scene.
    pub scene: String,
    /// The mean over targets; if the index has several entries for the scene, the mean of the entries' means, unless all
    /// images have the same weight.
    pub mean: f64,
    /// Its weight in the protocol's mean: the number of its entries, or of its targets.
    pub weight: f64,
    /// Targets that were compared.
    pub targets: u64,
    /// Compared targets whose render is bit-identical to the ground truth.
    pub identical: u64,
}

/// Means of scenes with at least one score, ordered by key.
pub fn scene_means(results: &Results, query: &MetricQuery) -> Vec<SceneMean> {
    weighted_scene_means(results, query, Aggregation::SceneMeans)
}

/// Like [`scene_means`], over entries or over targets as the protocol averages them: their weighted mean is that of
/// [`super::summary()`].
pub fn weighted_scene_means(results: &Results, query: &MetricQuery, aggregation: Aggregation) -> Vec<SceneMean> {
    means_of(&select(results, query), aggregation)
}

/// Like [`weighted_scene_means`], of several results, each over the targets that all of them have a score for, so that their
/// differences are paired. Targets are matched by scene, entry and frame, whatever their preset.
pub fn common_scene_means(queries: &[(&Results, MetricQuery<'_>)], aggregation: Aggregation) -> Vec<Vec<SceneMean>> {
    let selected: Vec<Vec<SelectedTarget>> = queries.iter().map(|(results, query)| select(results, query)).collect();
    let mut common: Option<BTreeSet<ImageKey<'_>>> = None;
    for targets in &selected {
        let images: BTreeSet<ImageKey<'_>> = SelectedTarget::scored(targets).map(|(image, ..)| image).collect();
        common = Some(common.map_or_else(|| images.clone(), |known| &known & &images));
    }
    let common = common.unwrap_or_default();
    let of_common = |targets: &Vec<SelectedTarget>| {
        let scored = SelectedTarget::scored(targets).filter(|(image, ..)| common.contains(image));
        let targets: Vec<SelectedTarget> = scored.map(|(_, target, _)| *target).collect();
        means_of(&targets, aggregation)
    };
    selected.iter().map(of_common).collect()
}

/// How many images some, but not all, of several results have a score for: those that [`common_scene_means`] leaves out.
pub fn unpaired_targets(queries: &[(&Results, MetricQuery<'_>)]) -> u64 {
    let mut scored_by: BTreeMap<ImageKey<'_>, usize> = BTreeMap::new();
    for (results, query) in queries {
        for (image, ..) in SelectedTarget::scored(&select(results, query)) {
            *scored_by.entry(image).or_default() += 1;
        }
    }
    scored_by.values().filter(|results| **results < queries.len()).count() as u64
}

/// The means of scenes with at least one score, of targets that are already selected and ordered.
fn means_of(selected: &[SelectedTarget], aggregation: Aggregation) -> Vec<SceneMean> {
    let clusters = clusters(selected, aggregation).into_iter();
    let mean = |cluster: Cluster| SceneMean {
        scene: cluster.scene.to_owned(),
        mean: cluster.sum / cluster.weight,
        weight: cluster.weight,
        targets: cluster.targets,
        identical: cluster.identical,
    };
    clusters.map(mean).filter(|scene| scene.mean.is_finite()).collect()
}

/// Which direction of a metric is better; metrics without a [`atsplat_metrics::Definition`] are better when lower.
pub fn direction(metric: &str) -> Direction {
    definition(metric).map_or(Direction::Lower, |definition| definition.direction)
}

/// The scenes with the worst means by the metric's direction, worst first; ties ordered by key.
pub fn worst(results: &Results, query: &MetricQuery, count: usize) -> Vec<SceneMean> {
    let mut scenes = scene_means(results, query);
    match direction(query.metric) {
        Direction::Higher => scenes.sort_by(|a, b| a.mean.total_cmp(&b.mean)),
        Direction::Lower => scenes.sort_by(|a, b| b.mean.total_cmp(&a.mean)),
    }
    scenes.truncate(count);
    scenes
}

/// A scene's contribution to a mean: `Σ sum / Σ weight` over scenes is the protocol's number.
#[derive(Clone, Debug)]
pub(super) struct Cluster<'a> {
    pub(super) scene: &'a str,
    pub(super) sum: f64,
    pub(super) weight: f64,
    pub(super) targets: u64,
    pub(super) identical: u64,
}

/// Scores by scene, in the order given, which is that of scene, entry and target.
///
/// Published evaluation loops process one index entry per batch and average over batches, so each entry has one vote, not each
/// scene (relevant for latentSplat's index); resampling still draws whole scenes.
pub(super) fn clusters<'a>(selected: &[SelectedTarget<'a>], aggregation: Aggregation) -> Vec<Cluster<'a>> {
    let mut clusters: Vec<Cluster<'a>> = Vec::new();
    for trial in selected.chunk_by(|a, b| (a.scene, a.entry) == (b.scene, b.entry)) {
        let (mut sum, mut targets, mut identical) = (0.0, 0u64, 0u64);
        for target in trial {
            if let Outcome::Score { value, identical: same } = target.outcome {
                sum += value;
                targets += 1;
                identical += u64::from(same);
            }
        }
        let Some(scene) = trial.first().map(|target| target.scene).filter(|_| targets > 0) else { continue };
        let (sum, weight) = match aggregation {
            Aggregation::SceneMeans => (sum / targets as f64, 1.0),
            Aggregation::AllImages => (sum, targets as f64),
        };
        match clusters.last_mut().filter(|last| last.scene == scene) {
            Some(last) => {
                last.sum += sum;
                last.weight += weight;
                last.targets += targets;
                last.identical += identical;
            }
            None => clusters.push(Cluster { scene, sum, weight, targets, identical }),
        }
    }
    clusters
}

/// The mean over clusters with their `[sum, weight]` pairs, from which intervals are resampled; `None` if it is not finite.
pub(super) fn mean_of_clusters(clusters: &[Cluster<'_>]) -> (Option<f64>, Vec<[f64; 2]>) {
    let parts: Vec<[f64; 2]> = clusters.iter().map(|cluster| [cluster.sum, cluster.weight]).collect();
    let [sum, weight] = parts.iter().fold([0.0, 0.0], |[sum, weight], [s, w]| [sum + s, weight + w]);
    (Some(sum / weight).filter(|mean| mean.is_finite()), parts)
}
