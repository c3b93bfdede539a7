use std::collections::{BTreeMap, BTreeSet};

use atsplat_pixels::DecodeLimits;
use atsplat_scene::{Frame, Scene, SceneSource, Warnings};
use serde::Serialize;

use super::{DepthFolder, LoadedDepth, OverlapEstimator, OverlapView, SceneDepths};
use crate::loading::{in_parallel, load};
use crate::{EvaluationIndex, IndexEntry, NoEntry, Overlap, ProtocolError};

/// An index with measured overlaps, and the entries whose overlap could not be measured.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct OverlapReport {
    /// The index with [`IndexEntry::overlap`] replaced; scenes and entries are unchanged.
    pub index: EvaluationIndex,
    /// Number of entries with a measured overlap.
    pub measured: usize,
    /// Number of these that had an overlap before, published or by another estimator.
    pub replaced: usize,
    /// Number of entries that had an overlap before and have none now, because it could not be measured.
    pub removed: usize,
    /// Number of entries whose overlap could not be measured, by [`NoEntry::name`].
    pub unmeasured: BTreeMap<&'static str, usize>,
    /// Number of scenes with such entries, by the same names.
    pub failed_scenes: BTreeMap<&'static str, usize>,
    /// The first such entry of the first few scenes, for each name, in index order.
    pub examples: Vec<UnmeasuredExample>,
}

/// An entry whose overlap could not be measured.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct UnmeasuredExample {
    /// Scene key.
    pub scene: String,
    /// Position of the entry in the scene.
    pub entry: usize,
    /// [`NoEntry::name`].
    pub reason: &'static str,
    /// The error's text.
    pub detail: String,
}

/// Scenes of which an entry is described, for each reason.
pub(super) const EXAMPLES_PER_REASON: usize = 3;

/// Measures the context overlap of every entry of an index on a dataset, in parallel over scenes; the result
/// does not depend on the number of threads. Overlaps stated by the index are replaced, or removed if they cannot be
/// measured. `depth` is required by estimators that need depth maps.
pub fn annotate_overlaps(
    index: &EvaluationIndex,
    source: &dyn SceneSource,
    estimator: &OverlapEstimator,
    depth: Option<&DepthFolder>,
    warnings: &mut Warnings,
) -> OverlapReport {
    let scenes: Vec<(&String, &Vec<IndexEntry>)> = index.scenes.iter().collect();
    let measured = in_parallel(&scenes, warnings, |(key, entries), warnings| {
        if entries.is_empty() {
            return Vec::new();
        }
        match load(source, key, warnings) {
            Ok(scene) => {
                let depths = depth.filter(|_| estimator.needs_depth()).map(|folder| folder.of_scene(&scene.key));
                entries.iter().map(|entry| context_overlap(&scene, entry, estimator, depths.as_ref())).collect()
            }
            Err(dropped) => vec![Err(NoEntry::from(dropped)); entries.len()],
        }
    });
    let mut annotated = index.clone();
    let mut report = OverlapReport::default();
    for ((key, entries), overlaps) in annotated.scenes.iter_mut().zip(measured) {
        let mut reasons_of_scene = BTreeSet::new();
        for ((at, entry), overlap) in entries.iter_mut().enumerate().zip(overlaps) {
            let before = usize::from(entry.overlap.is_some());
            match &overlap {
                Ok(_) => {
                    report.measured += 1;
                    report.replaced += before;
                }
                Err(error) => {
                    report.removed += before;
                    *report.unmeasured.entry(error.name()).or_default() += 1;
                    if reasons_of_scene.insert(error.name()) {
                        report.add_failed_scene(key, at, error);
                    }
                }
            }
            entry.overlap = overlap.ok().map(|value| Overlap { value, estimator: Some(estimator.name().to_owned()) });
        }
    }
    report.index = annotated;
    report
}

impl OverlapReport {
    /// Counts a scene with this error, which occurred first at the entry `at`.
    fn add_failed_scene(&mut self, scene: &str, at: usize, error: &NoEntry) {
        let scenes = self.failed_scenes.entry(error.name()).or_default();
        *scenes += 1;
        if *scenes <= EXAMPLES_PER_REASON {
            let (scene, reason, detail) = (scene.to_owned(), error.name(), error.to_string());
            self.examples.push(UnmeasuredExample { scene, entry: at, reason, detail });
        }
    }
}

/// The overlap of an entry's context frames in a loaded scene, with its depth maps for estimators that need them.
pub(crate) fn context_overlap(
    scene: &Scene,
    entry: &IndexEntry,
    estimator: &OverlapEstimator,
    depths: Option<&SceneDepths>,
) -> Result<f64, NoEntry> {
    let unreadable = |error: &dyn std::fmt::Display| NoEntry::Unreadable(error.to_string());
    let mut context = entry.context.clone();
    context.sort_unstable();
    let out_of_range =
        |frame: usize| NoEntry::TooFewFrames { needed: frame.saturating_add(1), found: scene.frames.len() };
    let frames = context
        .iter()
        .map(|frame| scene.frames.get(*frame).ok_or_else(|| out_of_range(*frame)))
        .collect::<Result<Vec<_>, _>>()?;
    let posed = context.iter().zip(&frames).try_for_each(|(at, frame)| frame.require_pose(&scene.key, *at));
    posed.map_err(|error| unreadable(&error))?;
    let images = if estimator.needs_images() {
        let decode = |frame: &usize| scene.decode(*frame, &DecodeLimits::default()).map(Some);
        context.iter().map(decode).collect::<Result<_, _>>().map_err(|error| unreadable(&error))?
    } else {
        vec![None; frames.len()]
    };
    let depths: Vec<Option<LoadedDepth>> = match depths.filter(|_| estimator.needs_depth()) {
        Some(depths) => {
            let load = |(position, frame): (&usize, &&Frame)| depth_of(depths, *position, frame).map(Some);
            context.iter().zip(&frames).map(load).collect::<Result<_, _>>()?
        }
        None => vec![None; frames.len()],
    };
    let views = frames.iter().zip(&images).zip(&depths).map(|((frame, image), depth)| {
        let depth = depth.as_ref().map(LoadedDepth::map).transpose()?;
        Ok(OverlapView { camera: &frame.camera, image: image.as_ref(), depth })
    });
    let views: Result<Vec<OverlapView<'_>>, ProtocolError> = views.collect();
    let needs_cameras_alone = frames.len() > 1 && !estimator.needs_images() && !estimator.needs_depth();
    let reason: fn(String) -> NoEntry = if needs_cameras_alone { NoEntry::Geometry } else { NoEntry::OverlapUndefined };
    views.and_then(|views| chain_overlap(estimator, &views)).map_err(|error| reason(error.to_string()))
}

/// The depth map of the frame at `position` of its scene. It has to fit the camera as an image has to: with a crop of the
/// frame, the camera's intrinsics would lift pixels to other points.
fn depth_of(depths: &SceneDepths, position: usize, frame: &Frame) -> Result<LoadedDepth, NoEntry> {
    let loaded = depths.load(&frame.name, &frame.camera).map_err(|error| NoEntry::Unreadable(error.to_string()))?;
    match frame.mismatch(loaded.size()) {
        Some(mismatch) if mismatch.is_fatal() => {
            Err(NoEntry::Unreadable(format!("frame {position}: depth map: {mismatch}")))
        }
        _ => Ok(loaded),
    }
}

/// The overlap of several views in frame order: the smallest overlap of two neighbours. For two views this is
/// what the papers publish; for more, no paper defines an overlap, and this is the weakest link of the chain.
///
/// # Errors
/// [`ProtocolError::Overlap`] with fewer than two views; otherwise those of [`OverlapEstimator::estimate`].
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
    use atsplat_camera::{ImageSize, NormalizedIntrinsics};
    use atsplat_numeric::Tolerance;
    use atsplat_pixels::exr::{self, Channel, Channels, Values};
    use atsplat_scene::WarningKind;
    use glam::{DMat3, DVec3};

    use super::*;
    use crate::overlap::EpipolarRays;
    use crate::samplers::test_scene::looking;
    use crate::test_source::{MemorySource, scene};

    fn entry(context: &[usize]) -> IndexEntry {
        IndexEntry { context: context.to_vec(), target: vec![1], overlap: Some(0.123.into()) }
    }

    #[test]
    fn replaces_overlaps_and_counts_unmeasured_entries() {
        let source = MemorySource::new([scene("a", 9, 0), scene("b", 9, 0)]).with_key("broken");
        let scenes = [
            ("a", vec![entry(&[0, 3]), entry(&[3, 0]), entry(&[0, 99])]),
            ("b", vec![entry(&[5])]),
            ("gone", vec![entry(&[0, 3]), entry(&[3, 0])]),
            ("broken", vec![entry(&[0, 3])]),
            ("null", Vec::new()),
        ];
        let index = EvaluationIndex { scenes: scenes.map(|(key, entries)| (key.to_owned(), entries)).into() };
        let estimator = OverlapEstimator::EpipolarRay(EpipolarRays::default());
        let mut warnings = Warnings::new();
        let report = annotate_overlaps(&index, &source, &estimator, None, &mut warnings);
        let overlaps =
            |key: &str| report.index.scenes[key].iter().map(|entry| entry.overlap.clone()).collect::<Vec<_>>();
        let a = overlaps("a");
        assert!(a[0].as_ref().is_some_and(|overlap| overlap.value > 0.5 && overlap.value < 1.0), "{a:?}");
        assert_eq!((&a[0], &a[2]), (&a[1], &None), "the order of context frames does not matter");
        assert_eq!(a[0].as_ref().and_then(|overlap| overlap.estimator.as_deref()), Some("epipolar-ray"));
        assert_eq!((report.replaced, report.removed), (2, 5), "every entry had one");
        assert_eq!((overlaps("b"), overlaps("gone")), (vec![None], vec![None; 2]), "no old overlap remains");
        assert_eq!(report.measured, 2);
        let unmeasured: Vec<_> = report.unmeasured.into_iter().collect();
        assert_eq!(
            unmeasured,
            [("overlap-undefined", 1), ("scene-missing", 2), ("too-few-frames", 1), ("unreadable", 1)]
        );
        assert_eq!(report.failed_scenes["scene-missing"], 1, "both entries are of one scene");
        let examples: Vec<_> = report.examples.iter().map(|e| (e.scene.as_str(), e.entry, e.reason)).collect();
        let expected = [("a", 2, "too-few-frames"), ("b", 0, "overlap-undefined"), ("gone", 0, "scene-missing")];
        assert_eq!((&examples[..3], examples[3]), (&expected[..], ("broken", 0, "unreadable")));
        assert!(report.examples[1].detail.contains("needs two views, found 1"), "{:?}", report.examples);
        assert_eq!(warnings.count(WarningKind::SceneNotFound), 1);
        assert_eq!(warnings.count(WarningKind::UnreadableScene), 1);
        assert_eq!(warnings.total(), 4, "and one for each of the two loaded scenes");
    }

    /// Of a scene with many entries one is described, so that the others are named too.
    #[test]
    fn each_scene_that_fails_is_an_example_before_its_other_entries_are() {
        let source = MemorySource::new([]);
        let scenes = ["a", "b", "c", "d"].map(|key| (key.to_owned(), vec![entry(&[0, 3]); 4]));
        let estimator = OverlapEstimator::EpipolarRay(EpipolarRays::default());
        let index = EvaluationIndex { scenes: scenes.into() };
        let report = annotate_overlaps(&index, &source, &estimator, None, &mut Warnings::new());
        let named: Vec<_> = report.examples.iter().map(|example| (example.scene.as_str(), example.entry)).collect();
        assert_eq!(named, [("a", 0), ("b", 0), ("c", 0)]);
        assert_eq!((report.unmeasured["scene-missing"], report.failed_scenes["scene-missing"]), (16, 4));
    }

    /// Cameras too far apart for f64 have no geometry; one view has no overlap, whatever its camera.
    #[test]
    fn failed_geometry_and_undefined_overlap_are_different_reasons() {
        let mut far = scene("far", 3, 0);
        for (frame, x) in far.frames.iter_mut().zip([-1e308, 1e308]) {
            frame.camera = looking(DMat3::IDENTITY, DVec3::new(x, 0.0, 0.0));
        }
        let estimator = OverlapEstimator::EpipolarRay(EpipolarRays::default());
        let reason = |context: &[usize]| context_overlap(&far, &entry(context), &estimator, None).unwrap_err().name();
        assert_eq!([reason(&[0, 1]), reason(&[0])], ["geometry", "overlap-undefined"]);
    }

    /// A wall at z = 4, seen by RE10K cameras of 640×360 that are a fifth of an image apart: of a centre crop, four
    /// fifths would be seen too. Not every source states the size of its frames.
    #[test]
    fn depth_maps_that_do_not_fit_the_camera_are_rejected() {
        let folder = tempfile::tempdir().unwrap();
        std::fs::create_dir(folder.path().join("clip")).unwrap();
        let mut clip = scene("clip", 3, 0);
        for (frame, (x, [width, height])) in
            clip.frames.iter_mut().zip([(0.0, [320u32, 180]), (1.6, [256, 256]), (1.6, [160, 90])])
        {
            frame.camera = looking(DMat3::IDENTITY, DVec3::new(x, 0.0, 0.0));
            frame.camera.intrinsics = NormalizedIntrinsics::new(0.5, 0.889, 0.5, 0.5).unwrap();
            let samples = vec![4.0; (width * height) as usize];
            let channel = Channel { name: "Z".to_owned(), values: Values::Depth, samples };
            let bytes = exr::write(&Channels::new(width, height, vec![channel]).unwrap()).unwrap();
            std::fs::write(folder.path().join(format!("clip/{}.exr", frame.name)), bytes).unwrap();
        }
        let depths = DepthFolder::open(folder.path()).unwrap().of_scene("clip");
        let estimator = OverlapEstimator::DepthCovisibility {};
        for stated in [None, Some(ImageSize { width: 640, height: 360 })] {
            for frame in &mut clip.frames {
                frame.stated_size = stated;
            }
            let measure = |context: &[usize]| context_overlap(&clip, &entry(context), &estimator, Some(&depths));
            Tolerance::EXACT.assert([measure(&[0, 2]).unwrap()], [0.8], "half and a quarter of the size");
            let error = measure(&[1, 0]).unwrap_err();
            let text = error.to_string();
            assert!(error.name() == "unreadable" && text.starts_with("frame 1: depth map: expected"), "{error:?}");
            assert!(text.contains("256×256"), "{text}");
        }
    }

    /// Three views in a row: the overlap is that of the worse pair of neighbours, not of the ends.
    #[test]
    fn the_overlap_of_a_chain_is_that_of_its_weakest_link() {
        let cameras = [0.0, 2.0, 9.0].map(crate::test_source::camera);
        let views = cameras.each_ref().map(|camera| OverlapView { camera, image: None, depth: None });
        let estimator = OverlapEstimator::EpipolarRay(EpipolarRays::default());
        let links = [estimator.estimate(&views[0], &views[1]), estimator.estimate(&views[1], &views[2])];
        let [first, second] = links.map(Result::unwrap);
        assert!(second < first, "{first} {second}");
        Tolerance::EXACT.assert([chain_overlap(&estimator, &views).unwrap()], [second], "chain");
        assert!(chain_overlap(&estimator, &views[..1]).is_err());
    }
}
