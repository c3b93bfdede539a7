use std::hash::{DefaultHasher, Hash, Hasher as _};

use atsplat_protocol::Aggregation;
use serde::Serialize;

use super::MetricQuery;
use super::bootstrap::{MIN_SCENES, interval_of_mean};
use super::scene_means::{Cluster, clusters, mean_of_clusters};
use super::selection::{Outcome, SelectedTarget, select};
use crate::Results;

/// A protocol's number with its counts, including what is missing from it.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct Summary {
    /// The protocol's mean, with or without identical images as [`MetricQuery::identical`] says; `None` without scores.
    pub mean: Option<f64>,
    /// Its 95 % interval over scenes ([`interval_of_mean`]); `None` with fewer than [`MIN_SCENES`].
    pub interval: Option<[f64; 2]>,
    /// Scenes in the mean.
    pub scenes: u64,
    /// Targets in the mean.
    pub targets: u64,
    /// Targets that are bit-identical to the ground truth, in the mean or not.
    pub identical: u64,
    /// Targets without a render or a ground truth; not in the mean.
    pub failed: u64,
    /// Targets of trials that the method does not support; not in the mean.
    pub not_applicable: u64,
    /// Targets whose render or score is not finite; not in the mean.
    pub non_finite: u64,
    /// Targets whose score was not computed; not in the mean.
    pub uncomputed: u64,
    /// Why the first of them was not computed.
    pub not_computed: Option<String>,
    /// Hash of all targets of the query, scored or not; means with different hashes are not comparable. `None` without targets.
    #[serde(skip)]
    pub target_set_hash: Option<u64>,
}

/// Hash of a set whose members are given in order, valid within one run of the program; `None` if it is empty.
pub(super) fn set_hash<T: Hash>(members: impl IntoIterator<Item = T>) -> Option<u64> {
    let mut members = members.into_iter().peekable();
    members.peek()?;
    let mut hasher = DefaultHasher::new();
    members.for_each(|member| member.hash(&mut hasher));
    Some(hasher.finish())
}

/// The number that a protocol with this aggregation publishes.
pub fn summary(results: &Results, query: &MetricQuery, aggregation: Aggregation) -> Summary {
    to_publish(&select(results, query), aggregation)
}

/// Like [`summary`], of targets that are already selected and ordered.
pub(super) fn to_publish(selected: &[SelectedTarget], aggregation: Aggregation) -> Summary {
    with_interval(selected, aggregation, MIN_SCENES)
}

/// Like [`summary`], of targets that are already selected and ordered, with an interval from two scenes on.
pub fn summary_of(selected: &[SelectedTarget], aggregation: Aggregation) -> Summary {
    with_interval(selected, aggregation, 0)
}

/// [`Summary::mean`] alone, of targets that are already selected and ordered: nothing is resampled.
pub fn mean_of(selected: &[SelectedTarget], aggregation: Aggregation) -> Option<f64> {
    mean_of_clusters(&clusters(selected, aggregation)).0
}

/// Like [`summary_of`], without an interval: nothing is resampled.
pub(crate) fn summary_without_interval(selected: &[SelectedTarget], aggregation: Aggregation) -> Summary {
    summary_of_clusters(selected, &clusters(selected, aggregation)).0
}

fn with_interval(selected: &[SelectedTarget], aggregation: Aggregation, least_scenes: u64) -> Summary {
    let (summary, parts) = summary_of_clusters(selected, &clusters(selected, aggregation));
    let has_interval = summary.mean.is_some() && summary.scenes >= least_scenes;
    Summary { interval: has_interval.then(|| interval_of_mean(&parts)).flatten(), ..summary }
}

/// Everything but the interval, and the parts to resample.
fn summary_of_clusters(selected: &[SelectedTarget], clusters: &[Cluster<'_>]) -> (Summary, Vec<[f64; 2]>) {
    let (mean, parts) = mean_of_clusters(clusters);
    let mut summary = Summary {
        mean,
        scenes: clusters.len() as u64,
        targets: clusters.iter().map(|cluster| cluster.targets).sum(),
        identical: clusters.iter().map(|cluster| cluster.identical).sum(),
        target_set_hash: set_hash(selected.iter().map(|target| (target.scene, target.entry, target.frame))),
        ..Summary::default()
    };
    for target in selected {
        match target.outcome {
            Outcome::Score { .. } => {}
            Outcome::Identical => summary.identical += 1,
            Outcome::NonFinite => summary.non_finite += 1,
            Outcome::Failed => summary.failed += 1,
            Outcome::NotApplicable => summary.not_applicable += 1,
            Outcome::NotComputed(reason) => {
                summary.uncomputed += 1;
                summary.not_computed.get_or_insert_with(|| reason.to_owned());
            }
        }
    }
    (summary, parts)
}
