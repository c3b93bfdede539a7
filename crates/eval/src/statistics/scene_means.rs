use atsplat_protocol::Aggregation;
use serde::Serialize;

use super::MetricQuery;
use super::selection::{Outcome, SelectedTarget, select};
use crate::Results;

/// What one scene scored.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct SceneMean {
    /// Key of the scene.
    pub scene: String,
    /// The mean over targets; where the index has several entries for the scene, the mean of the entries' means.
    pub mean: f64,
    /// Targets that were compared.
    pub targets: u64,
    /// Those that equal the truth to the bit.
    pub identical: u64,
}

/// Scenes with at least one score, in order of their keys.
pub fn scene_means(results: &Results, query: &MetricQuery) -> Vec<SceneMean> {
    let selected = select(results, query);
    let clusters = clusters(&selected, Aggregation::SceneMeans).into_iter();
    let mean = |cluster: Cluster| SceneMean {
        scene: cluster.scene.to_owned(),
        mean: cluster.sum / cluster.weight,
        targets: cluster.targets,
        identical: cluster.identical,
    };
    clusters.map(mean).filter(|scene| scene.mean.is_finite()).collect()
}

/// A scene's part of a mean: `Σ sum / Σ weight` over scenes is the protocol's number.
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
/// Published evaluation loops take one index entry at a time as a batch of one and average what the batches say, so an
/// entry, not a scene, has one vote where a scene has several (latentSplat's index); resampling still takes whole scenes.
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
            Aggregation::AllPictures => (sum, targets as f64),
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
