use std::collections::BTreeMap;

use atsplat_pixels::DecodeLimits;
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
    let pictures = if estimator.needs_pictures() {
        let decode = |frame: &usize| scene.decode(*frame, &DecodeLimits::default()).map(Some);
        context.iter().map(decode).collect::<Result<_, _>>().map_err(|error| NoEntry::Unreadable(error.to_string()))?
    } else {
        vec![None; frames.len()]
    };
    let views: Vec<OverlapView<'_>> = frames
        .iter()
        .zip(&pictures)
        .map(|(frame, picture)| OverlapView { camera: &frame.camera, picture: picture.as_ref(), depth: None })
        .collect();
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

#[cfg(test)]
mod tests {
    use atsplat_numeric::Tolerance;

    use super::*;
    use crate::overlap::EpipolarRays;
    use crate::test_source::{MemorySource, scene};

    fn entry(context: &[usize]) -> IndexEntry {
        IndexEntry { context: context.to_vec(), target: vec![1], overlap: Some(0.123) }
    }

    #[test]
    fn overlaps_are_replaced_and_gaps_counted() {
        let source = MemorySource::new([scene("a", 9, 0), scene("b", 9, 0)]);
        let scenes = [
            ("a", vec![entry(&[0, 3]), entry(&[3, 0]), entry(&[0, 99])]),
            ("b", vec![entry(&[5])]),
            ("gone", vec![entry(&[0, 3])]),
            ("null", Vec::new()),
        ];
        let index = EvaluationIndex { scenes: scenes.map(|(key, entries)| (key.to_owned(), entries)).into() };
        let estimator = OverlapEstimator::EpipolarRay(EpipolarRays::default());
        let mut warnings = Warnings::new();
        let report = annotate_overlaps(&index, &source, &estimator, &mut warnings);
        let overlaps = |key: &str| report.index.scenes[key].iter().map(|entry| entry.overlap).collect::<Vec<_>>();
        let a = overlaps("a");
        assert!(a[0].is_some_and(|overlap| overlap > 0.5 && overlap < 1.0), "{a:?}");
        assert_eq!((a[0], a[2]), (a[1], None), "the order of context plays no part");
        assert_eq!((overlaps("b"), overlaps("gone")), (vec![None], vec![None]), "no stale number stays");
        assert_eq!(report.measured, 2);
        let unmeasured: Vec<_> = report.unmeasured.into_iter().collect();
        assert_eq!(unmeasured, [("geometry", 1), ("too-few-frames", 1), ("unreadable", 1)]);
        assert_eq!(warnings.total(), 2, "those of the two scenes that exist");
    }

    /// Three views in a row: the number is that of the worse neighbours, not of the ends.
    #[test]
    fn a_chain_is_as_good_as_its_weakest_link() {
        let cameras = [0.0, 2.0, 9.0].map(crate::test_source::camera);
        let views = cameras.each_ref().map(|camera| OverlapView { camera, picture: None, depth: None });
        let estimator = OverlapEstimator::EpipolarRay(EpipolarRays::default());
        let links = [estimator.estimate(&views[0], &views[1]), estimator.estimate(&views[1], &views[2])];
        let [first, second] = links.map(Result::unwrap);
        assert!(second < first, "{first} {second}");
        Tolerance::EXACT.assert([chain_overlap(&estimator, &views).unwrap()], [second], "chain");
        assert!(chain_overlap(&estimator, &views[..1]).is_err());
    }
}
