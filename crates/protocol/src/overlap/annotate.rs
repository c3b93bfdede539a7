use std::collections::BTreeMap;

use atsplat_scene::{SceneSource, Warnings};
use rayon::prelude::*;

use super::{OverlapEstimator, OverlapView};
use crate::{EvaluationIndex, IndexEntry, NoEntry, ProtocolError};

/// An index with overlaps written into it, and what stayed without one.
#[derive(Clone, Debug, PartialEq)]
pub struct OverlapReport {
    /// The index, scenes and entries as they were, [`IndexEntry::overlap`] replaced.
    pub index: EvaluationIndex,
    /// Entries that have an overlap now.
    pub measured: usize,
    /// Entries whose overlap is unknown, by [`NoEntry::name`].
    pub unmeasured: BTreeMap<&'static str, usize>,
}

/// Measures the context overlap of every entry of an index on a dataset, in parallel over scenes; the result
/// does not depend on the number of threads. An overlap that the index shipped is replaced, by nothing where
/// it cannot be measured.
pub fn annotate_overlaps(
    index: &EvaluationIndex,
    source: &dyn SceneSource,
    estimator: &OverlapEstimator,
    warnings: &mut Warnings,
) -> OverlapReport {
    let scenes: Vec<(&String, &Vec<IndexEntry>)> = index.scenes.iter().collect();
    let measured: Vec<(Vec<Result<f64, NoEntry>>, Warnings)> =
        scenes.par_iter().map(|(key, entries)| measure_scene(key, entries, source, estimator)).collect();
    let mut report = OverlapReport { index: index.clone(), measured: 0, unmeasured: BTreeMap::new() };
    for (entries, (overlaps, scene_warnings)) in report.index.scenes.values_mut().zip(measured) {
        warnings.merge(scene_warnings);
        for (entry, overlap) in entries.iter_mut().zip(overlaps) {
            match &overlap {
                Ok(_) => report.measured += 1,
                Err(reason) => *report.unmeasured.entry(reason.name()).or_default() += 1,
            }
            entry.overlap = overlap.ok();
        }
    }
    report
}

fn measure_scene(
    key: &str,
    entries: &[IndexEntry],
    source: &dyn SceneSource,
    estimator: &OverlapEstimator,
) -> (Vec<Result<f64, NoEntry>>, Warnings) {
    let mut warnings = Warnings::new();
    if entries.is_empty() {
        return (Vec::new(), warnings);
    }
    let overlaps = match source.load(key, &mut warnings) {
        Err(error) => vec![Err(NoEntry::Unreadable(error.to_string())); entries.len()],
        Ok(scene) => entries.iter().map(|entry| context_overlap(&scene, entry, estimator)).collect(),
    };
    (overlaps, warnings)
}

/// Overlap of an entry's context frames in a loaded scene.
pub(crate) fn context_overlap(
    scene: &atsplat_scene::Scene,
    entry: &IndexEntry,
    estimator: &OverlapEstimator,
) -> Result<f64, NoEntry> {
    let mut context = entry.context.clone();
    context.sort_unstable();
    let out_of_range = |frame: usize| NoEntry::TooFewFrames { needed: frame + 1, found: scene.frames.len() };
    let frames = context
        .iter()
        .map(|frame| scene.frames.get(*frame).ok_or_else(|| out_of_range(*frame)))
        .collect::<Result<Vec<_>, _>>()?;
    let views: Vec<OverlapView<'_>> =
        frames.iter().map(|frame| OverlapView { camera: &frame.camera, picture: None, depth: None }).collect();
    chain_overlap(estimator, &views).map_err(|error| NoEntry::Geometry(error.to_string()))
}

/// Overlap of several views in frame order: the smallest overlap of two neighbours. For two views it is
/// what the papers publish; for more, no paper defines one, and this tells how well the chain holds.
///
/// # Errors
/// [`ProtocolError::Overlap`] with fewer than two views, or as [`OverlapEstimator::estimate`].
pub fn chain_overlap(estimator: &OverlapEstimator, views: &[OverlapView<'_>]) -> Result<f64, ProtocolError> {
    let mut smallest: Option<f64> = None;
    for (a, b) in views.iter().zip(views.iter().skip(1)) {
        let overlap = estimator.estimate(a, b)?;
        if smallest.is_none_or(|so_far| overlap < so_far) {
            smallest = Some(overlap);
        }
    }
    smallest.ok_or_else(|| ProtocolError::Overlap {
        estimator: estimator.name(),
        reason: format!("needs two views, found {}", views.len()),
    })
}
