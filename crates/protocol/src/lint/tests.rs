//! The lint of a small index with every irregularity, and of a dataset with every defect.

use std::sync::Arc;

use atsplat_camera::{Camera, CameraFromWorld, ImageSize, NormalizedIntrinsics};
use atsplat_files::Malformed;
use atsplat_scene::preprocess::{CentreCrop, Preprocessing, Step};
use atsplat_scene::{Frame, FrameImage, Scene, SceneError, SceneSource, SharedBytes, WarningKind, Warnings};
use atsplat_tests::on_threads;
use glam::{DMat3, DVec3};
use image::{ExtendedColorType, ImageEncoder as _, codecs::png::PngEncoder};

use super::{CountDistribution, DatasetCheck, LintOptions, PresetMatch, lint, lint_file};
use crate::test_source::{MemorySource, scene};
use crate::trial::{Prefetch, SkipReason, TrialRecipe, Trials};
use crate::{DropReason, EvaluationIndex, IndexEntry, IndexFile, LintReport, Preset};

const ODD: &str = r#"{
"null": null,
"plain": {"context": [10, 60], "target": [20, 30]},
"leaked": {"context": [0, 40], "target": [0, 40, 5, 5], "overlap": 0.04},
"outside": {"context": [5, 5, 30], "target": [4, 31, 30], "overlap": "large"},
"twice": [{"context": [1, 2], "target": [1]}, {"context": [1, 2], "target": [1], "note": 7}],
"empty": {"context": [], "target": []},
"plain": {"context": [10, 60], "target": [20, 30], "overlap": 0.2}
}"#;

fn report(json: &str) -> LintReport {
    let file = IndexFile::parse(json.as_bytes()).unwrap();
    lint_file(&file, &LintOptions::default(), &mut Warnings::new())
}

#[test]
fn counts_every_irregularity() {
    let report = report(ODD);
    assert_eq!((report.keys, report.null, report.scenes, report.entries, report.targets), (6, 1, 5, 6, 11));
    assert_eq!((report.leaked.targets, report.leaked.scenes), (5, 3));
    assert_eq!((report.outside_window.targets, report.outside_window.scenes), (2, 1));
    assert_eq!(report.windows_at_zero, 1);
    assert_eq!((report.repeats.targets, report.repeats.context, report.repeats.entries), (1, 1, 1));
    assert_eq!((report.without_context, report.without_targets), (1, 1));
    let overlap = report.overlap.unwrap();
    assert_eq!(overlap.published.to_string(), "small 1, medium 1, large 1, without 3");
    assert_eq!(overlap.strict.to_string(), "small 1, medium 0, large 1, below range 1, without 3");
    assert!(overlap.estimators.is_empty() && overlap.definition.contains("does not say"), "{overlap:?}");
}

#[test]
fn the_text_shows_what_the_json_holds() {
    insta::assert_snapshot!(report(ODD).to_string());
    insta::assert_snapshot!(serde_json::to_string_pretty(&report(ODD)).unwrap());
}

/// Two of three frames are inputs, and neither is a target.
#[test]
fn frames_that_are_not_scored_and_overlaps_that_were_not_measured_are_odd() {
    let entry = r#"{"context": [0, 9], "target": [0, 3, 9], "target_quantify": [3], "overlap": -1.0}"#;
    let report = report(&format!(r#"{{"a": {entry}}}"#));
    assert_eq!((report.targets, report.leaked.targets, report.overlap.is_none()), (1, 0, true));
    let text = report.to_string();
    assert!(text.contains("odd                 1 overlap of -1, read as none\n"), "{text}");
    let unscored = "2 frames of the field \"target\" are no targets: \"target_quantify\" lists those to score\n";
    assert!(text.contains(unscored), "{text}");
}

#[test]
fn an_empty_index_has_no_spreads_and_no_percentages() {
    let text = report("{}").to_string();
    assert!(text.contains("keys                0: 0 null, 0 scenes"), "{text}");
    assert!(!text.contains("NaN"), "{text}");
    assert!(!text.contains("odd") && !text.contains("repeated"), "nothing is odd: {text}");
}

#[test]
fn medians_of_odd_and_even_counts() {
    let distribution = |counts: &[u64]| CountDistribution::of(counts.iter().copied());
    assert_eq!(distribution(&[3, 1, 2]), Some(CountDistribution { min: 1, median: 2.0, mean: 2.0, max: 3 }));
    assert_eq!(distribution(&[4, 1]), Some(CountDistribution { min: 1, median: 2.5, mean: 2.5, max: 4 }));
    assert_eq!(distribution(&[]), None);
}

/// Scenes of ten frames; the key of a defective scene names its defect.
struct Dataset {
    keys: Vec<String>,
}

impl SceneSource for Dataset {
    fn keys(&self) -> &[String] {
        &self.keys
    }

    fn load(&self, key: &str, warnings: &mut Warnings) -> Result<Scene, SceneError> {
        if !self.keys.iter().any(|known| known == key) {
            return Err(SceneError::UnknownScene { key: key.to_owned(), path: "dataset".into() });
        }
        if key == "broken" {
            return Err(Malformed::new("test", "line 2", "19 columns", 3).in_file("broken.txt").into());
        }
        warnings.push(WarningKind::DuplicateTimestamp, key, "frames 1 and 2");
        let fx = if key == "wide" { 0.3 } else { 0.5 };
        let frame = |at: u32| Frame {
            name: at.to_string(),
            timestamp_micros: None,
            camera: Camera::pinhole(
                CameraFromWorld::new(DMat3::IDENTITY, DVec3::new(f64::from(at), 0.0, 0.0)).unwrap(),
                NormalizedIntrinsics::new(fx, 0.9, 0.5, 0.5).unwrap(),
            ),
            stated_size: Some(ImageSize { width: 640, height: 360 }),
            image: FrameImage::Absent,
        };
        Ok(Scene { key: key.to_owned(), url: None, frames: (0..10).map(frame).collect() })
    }
}

fn dataset_report(threads: usize) -> (LintReport, Warnings) {
    let json = r#"{"good": {"context": [0, 9], "target": [4]}, "left-out": null, "gone": {"context": [0], "target": [1]},
        "broken": {"context": [0], "target": [1]}, "wide": {"context": [0], "target": [1]},
        "short": [{"context": [0], "target": [9]}, {"context": [0], "target": [10]}]}"#;
    let keys = ["broken", "extra", "good", "left-out", "short", "wide"].map(str::to_owned).to_vec();
    let source = Dataset { keys };
    let preset = Preset::named("re10k-2v-256").unwrap();
    let recipe = TrialRecipe { allow_absent_images: true, ..TrialRecipe::of(&preset, "") };
    let dataset = DatasetCheck { source: &source, recipe };
    let options = LintOptions { dataset: Some(dataset), ..LintOptions::default() };
    let index = EvaluationIndex::from_json(json.as_bytes()).unwrap();
    let mut warnings = Warnings::new();
    let report = on_threads(threads, || lint(&index, &options, &mut warnings));
    (report, warnings)
}

#[test]
fn scenes_are_dropped_by_reason() {
    let (report, warnings) = dataset_report(2);
    let facts = report.dataset.as_ref().unwrap();
    let expected = [
        (DropReason::SceneMissing, 1),
        (DropReason::Unreadable, 1),
        (DropReason::FrameOutOfRange, 1),
        (DropReason::FieldOfView, 1),
    ]
    .map(|(reason, count)| (SkipReason::Dropped(reason), count));
    assert_eq!(facts.dropped, expected.into());
    assert_eq!((facts.usable, facts.unused_scenes), (2, 2));
    assert_eq!(warnings.count(WarningKind::SceneNotFound), 1);
    assert_eq!(warnings.count(WarningKind::UnreadableScene), 1);
    assert_eq!(warnings.count(WarningKind::DuplicateTimestamp), 3, "the loader's own warnings are reported");
    insta::assert_snapshot!(facts.to_string());
}

#[test]
fn the_report_does_not_depend_on_the_number_of_threads() {
    let (one, four) = (dataset_report(1), dataset_report(4));
    assert_eq!(one.0, four.0);
    assert_eq!(one.1.kept(), four.1.kept());
}

/// With missing, absent, unreadable, too small and transparent images, the lint counts the trials that [`Trials`]
/// yields, and gives the same warnings.
#[test]
fn lint_and_trials_agree() {
    let broken = |key: &str, image: FrameImage| {
        let mut scene = scene(key, 9, 0);
        scene.frames[4].image = image;
        scene
    };
    let mut transparent = Vec::new();
    let pixels: Vec<u8> = [9, 8, 7, 0].repeat(64 * 48);
    PngEncoder::new(&mut transparent).write_image(&pixels, 64, 48, ExtendedColorType::Rgba8).unwrap();
    let scenes = || {
        [
            scene("fine", 9, 0),
            broken("transparent", FrameImage::Encoded(SharedBytes::new(transparent.clone()))),
            broken("missing", FrameImage::Missing("4.png".into())),
            broken("absent", FrameImage::Absent),
            broken("garbled", FrameImage::Encoded(SharedBytes::new(b"no image".to_vec()))),
        ]
    };
    let entry = |target: usize| IndexEntry { context: vec![2, 6], target: vec![target], overlap: None };
    let keys = ["fine", "missing", "absent", "garbled", "transparent", "gone"];
    let index = EvaluationIndex {
        scenes: keys.map(|key| (key.to_owned(), vec![entry(4), entry(5), entry(12)])).into_iter().collect(),
    };
    for (crop, usable) in [(32, 7), (64, 0)] {
        let mut preset = Preset::named("re10k-2v-256").unwrap();
        preset.preprocessing = Preprocessing::of([Step::from(CentreCrop::new(crop, crop))]);
        let source = MemorySource::new(scenes());
        let dataset = DatasetCheck::of(&source, &preset);
        let options = LintOptions { dataset: Some(dataset), ..LintOptions::default() };
        let mut warnings = Warnings::new();
        let facts = lint(&index, &options, &mut warnings).dataset.unwrap();
        let source = Arc::new(MemorySource::new(scenes()));
        let mut trials = Trials::new(source, &index, TrialRecipe::of(&preset, ""), Prefetch::default());
        trials.by_ref().for_each(drop);
        let skipped = trials.report().counts().into_iter().map(|(reason, count)| (reason, count as u64));
        assert_eq!((facts.usable, facts.dropped), (trials.report().trials as u64, skipped.collect()));
        assert_eq!(facts.usable, usable, "crop of {crop}");
        assert_eq!(warnings.count(WarningKind::DroppedAlpha), 1, "one entry uses the image");
        assert_eq!(warnings.total(), trials.warnings().total());
    }
}

/// 0.04, 0.2 and 0.75 by an estimator that the published edges were not made for: one in each third.
#[test]
fn overlaps_of_another_estimator_get_their_own_bins() {
    let entry = |overlap: f64| {
        let overlap = crate::Overlap { value: overlap, estimator: Some("epipolar-ray".to_owned()) };
        vec![IndexEntry { context: vec![0, 2], target: vec![1], overlap: Some(overlap) }]
    };
    let scenes = [("a", 0.04), ("b", 0.2), ("c", 0.75)].map(|(key, overlap)| (key.to_owned(), entry(overlap)));
    let index = EvaluationIndex { scenes: scenes.into() };
    let report = lint(&index, &LintOptions::default(), &mut Warnings::new());
    let overlap = report.overlap.unwrap();
    assert_eq!(overlap.strict.to_string(), "low 1, middle 1, high 1");
    assert!(overlap.definition.contains("epipolar-ray"), "{}", overlap.definition);
}

/// Readers of JSON keep one of two fields of the same name.
#[test]
fn a_match_names_its_preset_and_its_index() {
    let preset = Preset::named("rooms-2v-128").unwrap();
    let file = IndexFile::embedded("rooms-2v").unwrap().unwrap();
    let json = serde_json::to_string(&PresetMatch::new(&preset, &file)).unwrap();
    assert_eq!(json, r#"{"name":"rooms-2v-128","match":"default","index":"rooms-2v"}"#);
}
