mod checks;
mod named;

use std::collections::{BTreeMap, BTreeSet, HashSet};

use atsplat_camera::Camera;
use atsplat_scene::{FrameImage, Scene, SceneSource, WarningKind, Warnings};
use serde::{Deserialize, Serialize};

use crate::loading::{in_parallel, load};
use crate::overlap::{FeatureOverlap, OverlapEstimator, context_overlap};
use crate::samplers::{NoEntry, Sampler, SceneViews};
use crate::{EvaluationIndex, IndexEntry, Overlap};

/// How to build an evaluation index for a dataset that has none: which frames to choose, and which overlap to require.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub struct SamplingRule {
    /// Chooses context and target frames.
    pub sampler: Sampler,
    /// Measures the overlap of the context views and rejects entries outside its bounds.
    #[serde(default)]
    pub overlap: Option<OverlapRule>,
}

/// Which overlap is written into the index, and its allowed range.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub struct OverlapRule {
    /// Estimator for neighbouring context frames (see [`crate::overlap::chain_overlap`]).
    pub estimator: OverlapEstimator,
    /// Smallest overlap kept, in [0, 1].
    #[serde(default)]
    pub minimum: f64,
    /// Largest overlap kept, at least the smallest.
    #[serde(default = "full_overlap")]
    pub maximum: f64,
}

const fn full_overlap() -> f64 {
    1.0
}

/// A built index, with the reasons for its `null` scenes.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct BuiltIndex {
    /// Every key of the dataset, in its order; `null` (no entries) if no entry could be built.
    pub index: EvaluationIndex,
    /// Scenes with at least one entry.
    pub scenes: usize,
    /// Total number of entries.
    pub entries: usize,
    /// Number of scenes without an entry, by [`NoEntry::name`].
    pub nulls: BTreeMap<&'static str, usize>,
    /// The first of these scenes for each reason, with its numbers: `SCENE: needs 6 frames, has 5`.
    pub first_nulls: BTreeMap<&'static str, String>,
    /// Sampled entries that the overlap rule rejected, or whose overlap could not be measured. A scene that lost all of them
    /// is counted in `nulls` too.
    pub rejected_entries: usize,
    /// Frames excluded from sampling because their image files are missing or their poses are not usable.
    pub missing_images: usize,
    /// Frames excluded from sampling because they show the image file of an earlier frame.
    pub repeated_images: usize,
}

impl SamplingRule {
    /// The same rule with [`OverlapEstimator::with_features`].
    #[must_use]
    pub fn with_features(mut self, measure: Option<FeatureOverlap>) -> Self {
        self.overlap =
            self.overlap.map(|rule| OverlapRule { estimator: rule.estimator.with_features(measure), ..rule });
        self
    }

    /// Samples all scenes of `source` in parallel; the index does not depend on the number of threads. Frames with a
    /// missing image file or without a usable pose, and those that repeat an earlier frame's file, are excluded from sampling:
    /// windows and distances of samplers count the others only, so they span more frames of such scenes; frame numbers still
    /// count all.
    ///
    /// `progress` is called once per scene, from any thread. Unreadable scenes become `null` and add a
    /// [`WarningKind::UnreadableScene`]; an entry whose images cannot be read for its overlap is rejected and adds a
    /// [`WarningKind::UnreadableImage`], as does each image of the index whose header cannot be read.
    pub fn build(&self, source: &dyn SceneSource, progress: &(dyn Fn() + Sync), warnings: &mut Warnings) -> BuiltIndex {
        let outcomes = in_parallel(source.keys(), warnings, |key, warnings| {
            let outcome = self.build_scene(key, source, warnings);
            progress();
            outcome
        });
        let mut built = BuiltIndex::default();
        for (key, Outcome { entries, rejected, missing, repeated }) in source.keys().iter().zip(outcomes) {
            built.rejected_entries += rejected;
            built.missing_images += missing;
            built.repeated_images += repeated;
            let entries = match entries {
                Ok(entries) => {
                    built.scenes += 1;
                    built.entries += entries.len();
                    entries
                }
                Err(reason) => {
                    *built.nulls.entry(reason.name()).or_default() += 1;
                    built.first_nulls.entry(reason.name()).or_insert_with(|| format!("{key}: {reason}"));
                    Vec::new()
                }
            };
            built.index.scenes.insert(key.clone(), entries);
        }
        built
    }

    fn build_scene(&self, key: &str, source: &dyn SceneSource, warnings: &mut Warnings) -> Outcome {
        let scene = match load(source, key, warnings) {
            Ok(scene) => scene,
            Err(dropped) => return Outcome { entries: Err(dropped.into()), rejected: 0, missing: 0, repeated: 0 },
        };
        let SampledFrames { numbers, cameras, missing, repeated } = SampledFrames::of(&scene);
        let mut rejected = 0;
        let entries = self.sampler.sample(&SceneViews { key, cameras: &cameras }).and_then(|sampled| {
            let sampled: Vec<_> = sampled.into_iter().map(|entry| renumbered(entry, &numbers)).collect();
            let Some(rule) = self.overlap else { return Ok(sampled) };
            let sampled_count = sampled.len();
            let (kept, last_reason) = rule.keep(&scene, sampled, warnings);
            rejected = sampled_count - kept.len();
            // No reason means that nothing was sampled, which samplers report as an error themselves.
            if kept.is_empty() { Err(last_reason.unwrap_or(NoEntry::NoPair)) } else { Ok(kept) }
        });
        report_unreadable(&scene, entries.iter().flatten(), warnings);
        Outcome { entries, rejected, missing, repeated }
    }
}

/// The frames of a scene among which samplers choose.
#[derive(Default)]
struct SampledFrames {
    /// Their numbers in the scene.
    numbers: Vec<usize>,
    cameras: Vec<Camera>,
    /// How many others have no image file or no usable pose.
    missing: usize,
    /// How many others repeat an earlier frame's file.
    repeated: usize,
}

impl SampledFrames {
    fn of(scene: &Scene) -> Self {
        let mut sampled = Self::default();
        let mut files = HashSet::new();
        for (number, frame) in scene.frames.iter().enumerate() {
            match &frame.image {
                FrameImage::Missing(_) | FrameImage::Ambiguous(_) | FrameImage::Unposed { .. } => sampled.missing += 1,
                FrameImage::File(path) if !files.insert(path) => sampled.repeated += 1,
                _ => {
                    sampled.numbers.push(number);
                    sampled.cameras.push(frame.camera);
                }
            }
        }
        sampled
    }
}

/// Warns of each image of `entries` whose header cannot be read, such as that of an empty file.
fn report_unreadable<'a>(scene: &Scene, entries: impl Iterator<Item = &'a IndexEntry>, warnings: &mut Warnings) {
    let frames: BTreeSet<usize> =
        entries.flat_map(|entry| entry.context.iter().chain(&entry.target)).copied().collect();
    let available = frames.into_iter().filter_map(|number| Some((number, scene.frames.get(number)?)));
    for (number, frame) in available.filter(|(_, frame)| frame.image.is_available()) {
        if let Err(error) = frame.header(&scene.key, number) {
            warnings.push(WarningKind::UnreadableImage, scene.key.as_str(), error.to_string());
        }
    }
}

/// The result of sampling one scene.
struct Outcome {
    /// Its entries, or why it has none.
    entries: Result<Vec<IndexEntry>, NoEntry>,
    /// Entries rejected for their overlap.
    rejected: usize,
    /// Frames whose images are missing.
    missing: usize,
    /// Frames that repeat an earlier frame's file.
    repeated: usize,
}

/// The entry with the scene's numbers of the frames that the sampler was given.
fn renumbered(entry: IndexEntry, frame_numbers: &[usize]) -> IndexEntry {
    #[expect(clippy::expect_used, reason = "samplers choose among the frames that they are given")]
    let original = |frame: usize| *frame_numbers.get(frame).expect("a frame that the sampler was given");
    IndexEntry {
        context: entry.context.into_iter().map(original).collect(),
        target: entry.target.into_iter().map(original).collect(),
        overlap: entry.overlap,
    }
}

impl OverlapRule {
    /// The entries within the bounds, with their overlap, and why the last of the others was rejected.
    fn keep(
        &self,
        scene: &Scene,
        sampled: Vec<IndexEntry>,
        warnings: &mut Warnings,
    ) -> (Vec<IndexEntry>, Option<NoEntry>) {
        let mut kept = Vec::new();
        let mut last_reason = None;
        for mut entry in sampled {
            match context_overlap(scene, &entry, &self.estimator, None) {
                Ok(overlap) if overlap >= self.minimum && overlap <= self.maximum => {
                    let estimator = Some(self.estimator.name().to_owned());
                    entry.overlap = Some(Overlap { value: overlap, estimator });
                    kept.push(entry);
                }
                Ok(overlap) => {
                    last_reason = Some(NoEntry::OverlapOutside {
                        overlap: format!("{overlap:.5}"),
                        minimum: self.minimum.to_string(),
                        maximum: self.maximum.to_string(),
                    });
                }
                Err(reason) => {
                    if let NoEntry::Unreadable(detail) = &reason {
                        warnings.push(WarningKind::UnreadableImage, scene.key.as_str(), detail.as_str());
                    }
                    last_reason = Some(reason);
                }
            }
        }
        (kept, last_reason)
    }
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::{AtomicUsize, Ordering};

    use atsplat_scene::SharedBytes;
    use atsplat_tests::on_threads;

    use super::*;
    use crate::test_source::{MemorySource, scene};

    fn rule(text: &str) -> SamplingRule {
        toml::from_str(text).unwrap()
    }

    const FARTHEST: &str = "[sampler]\nsampler = 'farthest-point'\nwindow = 10\ncontext-views = 2\ntargets = { rule = 'sampled', count = 3, seed = 7, allow-context = false }\n";

    fn source() -> MemorySource {
        let lengths = [12, 1, 9, 4, 30];
        MemorySource::new(lengths.iter().zip(["e", "d", "c", "b", "a"]).map(|(frames, key)| scene(key, *frames, 0)))
    }

    #[test]
    fn keeps_the_order_of_keys_and_the_reasons_for_nulls() {
        let mut warnings = Warnings::new();
        let calls = AtomicUsize::new(0);
        let progress = || {
            calls.fetch_add(1, Ordering::SeqCst);
        };
        let built = rule(FARTHEST).build(&source(), &progress, &mut warnings);
        assert_eq!(built.index.scenes.keys().collect::<Vec<_>>(), ["e", "d", "c", "b", "a"]);
        assert_eq!((built.scenes, built.entries, calls.into_inner()), (3, 3, 5));
        assert_eq!(built.nulls.into_iter().collect::<Vec<_>>(), [("too-few-frames", 1), ("too-few-targets", 1)]);
        assert_eq!(built.first_nulls["too-few-frames"], "d: needs 2 frames, has 1");
        assert_eq!(built.first_nulls["too-few-targets"], "b: needs 3 target frames, has 2 candidates");
        assert_eq!(built.index.scenes["e"][0].context, [0, 9]);
        assert_eq!(warnings.total(), 5);
    }

    #[test]
    fn the_index_does_not_depend_on_the_number_of_threads() {
        let build = |threads| on_threads(threads, || rule(FARTHEST).build(&source(), &|| (), &mut Warnings::new()));
        let one = build(1);
        assert!(one.index.scenes["e"][0].target != one.index.scenes["a"][0].target, "each scene has its own stream");
        for threads in [2, 3, 8] {
            assert_eq!(build(threads), one, "{threads} threads");
        }
    }

    #[test]
    fn rejects_entries_outside_the_overlap_bounds() {
        let with_bounds = |minimum: f64, maximum: f64| {
            format!(
                "{FARTHEST}[overlap]\nestimator = {{ estimator = 'epipolar-ray' }}\nminimum = {minimum}\nmaximum = {maximum}\n"
            )
        };
        let all = rule(&with_bounds(0.0, 1.0)).build(&source(), &|| (), &mut Warnings::new());
        let measured = all.index.scenes["e"][0].overlap.clone().unwrap();
        assert_eq!(measured.estimator.as_deref(), Some("epipolar-ray"));
        let overlap = measured.value;
        assert!(overlap > 0.05 && overlap < 0.95, "{overlap}");
        let none = rule(&with_bounds(overlap + 0.01, 1.0)).build(&source(), &|| (), &mut Warnings::new());
        assert_eq!((none.nulls["overlap-outside"], none.rejected_entries), (2, 2), "a and e; c overlaps more");
        let at_the_bound = rule(&with_bounds(overlap, overlap)).build(&source(), &|| (), &mut Warnings::new());
        assert_eq!(at_the_bound.index.scenes["e"], all.index.scenes["e"], "bounds are inclusive");
        let unbounded = format!("{FARTHEST}[overlap]\nestimator = {{ estimator = 'epipolar-ray' }}\n");
        let unbounded = rule(&unbounded).build(&source(), &|| (), &mut Warnings::new());
        assert_eq!(unbounded.index, all.index, "any overlap by default");
    }

    /// Frames 1, 4 and 11 have no image: the tenth frame with an image is frame 12.
    #[test]
    fn never_samples_frames_with_missing_images() {
        let missing = [1, 4, 11];
        let mut incomplete = scene("s", 14, 0);
        for at in missing {
            incomplete.frames[at].image = FrameImage::Missing(format!("{at}.png").into());
        }
        incomplete.frames[4].image = FrameImage::Ambiguous(vec!["4.jpg".into(), "4.png".into()]);
        let source = MemorySource::new([incomplete, scene("whole", 14, 0)]);
        let built = rule(FARTHEST).build(&source, &|| (), &mut Warnings::new());
        assert_eq!((built.scenes, built.missing_images), (2, 3));
        let entry = |key: &str| built.index.scenes[key][0].clone();
        assert_eq!((entry("s").context, entry("whole").context), (vec![0, 12], vec![0, 9]));
        let targets = entry("s").target;
        assert!(targets.iter().all(|frame| !missing.contains(frame) && (0..=12).contains(frame)), "{targets:?}");
    }

    #[test]
    fn never_samples_frames_without_a_usable_pose() {
        let mut unposed = scene("s", 14, 0);
        for at in [1, 4, 11] {
            unposed.frames[at].image = FrameImage::Absent.unposed("no rotation");
        }
        let built = rule(FARTHEST).build(&MemorySource::new([unposed]), &|| (), &mut Warnings::new());
        assert_eq!((built.scenes, built.missing_images), (1, 3));
        assert_eq!(built.index.scenes["s"][0].context, [0, 12]);
    }

    /// Each file is listed twice, one after the other.
    #[test]
    fn never_samples_a_second_frame_of_one_file() {
        let listed = |name: &str, file: fn(usize) -> usize| {
            let mut repeating = scene(name, 24, 0);
            for (number, frame) in repeating.frames.iter_mut().enumerate() {
                frame.image = FrameImage::File(format!("/no/such/{}.png", file(number)).into());
            }
            repeating
        };
        let source = MemorySource::new([listed("twice", |number| number / 2), listed("once", |number| number)]);
        let mut warnings = Warnings::new();
        let built = rule(FARTHEST).build(&source, &|| (), &mut warnings);
        assert_eq!((built.repeated_images, built.missing_images), (12, 0));
        let entry = &built.index.scenes["twice"][0];
        assert!(entry.context.iter().chain(&entry.target).all(|frame| frame % 2 == 0), "{entry:?}");
        assert_eq!(entry.context, [0, 18], "the tenth of the frames that remain");
        let frames = |key: &str| built.index.scenes[key][0].context.len() + built.index.scenes[key][0].target.len();
        let listed = frames("twice") + frames("once");
        assert_eq!(warnings.count(WarningKind::UnreadableImage), listed as u64, "none of these files exists");
        assert!(warnings.kept().iter().any(|warning| warning.detail.contains("no/such/9.png")), "{warnings:?}");
    }

    #[test]
    fn unreadable_scenes_become_null_with_a_warning() {
        let source = MemorySource::new([scene("kept", 12, 0)]).with_key("lost");
        let mut warnings = Warnings::new();
        let built = rule(FARTHEST).build(&source, &|| (), &mut warnings);
        assert_eq!((built.scenes, built.nulls["unreadable"]), (1, 1));
        assert!(built.index.scenes["lost"].is_empty());
        assert_eq!(warnings.count(WarningKind::UnreadableScene), 1);
    }

    #[test]
    fn entries_rejected_for_an_unreadable_image_are_warned_of() {
        let mut garbled = scene("garbled", 12, 0);
        garbled.frames[1].image = FrameImage::Missing("1.png".into());
        garbled.frames[10].image = FrameImage::Encoded(SharedBytes::new(b"no image".to_vec()));
        let source = MemorySource::new([garbled, scene("whole", 12, 0)]);
        let half: FeatureOverlap = |_, _| Ok(0.5);
        let by_features = rule(&format!("{FARTHEST}[overlap]\nestimator = {{ estimator = 'feature-coverage' }}\n"));
        let mut warnings = Warnings::new();
        let built = by_features.with_features(Some(half)).build(&source, &|| (), &mut warnings);
        let measured = Overlap { value: 0.5, estimator: Some("feature-coverage".to_owned()) };
        assert_eq!(built.index.scenes["whole"][0].overlap, Some(measured));
        assert_eq!((built.nulls["unreadable"], built.rejected_entries), (1, 1));
        assert_eq!(warnings.count(WarningKind::UnreadableImage), 1);
        let named = warnings.kept().iter().any(|warning| warning.detail.starts_with("frame 10 of scene \"garbled\": "));
        assert!(named, "counted with the missing frame: {:?}", warnings.kept());
    }
}
