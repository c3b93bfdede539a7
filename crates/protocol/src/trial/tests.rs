mod limits;
mod prefetch;
mod targets;
mod unposed;

use std::sync::Arc;
use std::sync::atomic::Ordering;

use atsplat_camera::{Distortion, MeanCameraScale, NormalizedIntrinsics, PoseNormalisation};
use atsplat_numeric::Tolerance;
use atsplat_pixels::DecodeLimits;
use atsplat_scene::preprocess::{CentreCrop, Preprocessing, Step};
use atsplat_scene::{FrameImage, Scene, SharedBytes, WarningKind};

use super::*;
use crate::preset::{DisparityPlanes, DropReason, Filters, LensDistortion};
use crate::test_source::{MemorySource, SIZE, camera, png, scene};
use crate::{EvaluationIndex, ProtocolError};

fn recipe() -> TrialRecipe {
    TrialRecipe {
        preprocessing: Preprocessing::of([Step::from(CentreCrop::new(32, 32))]),
        lens_distortion: LensDistortion::Used,
        pose_normalisation: PoseNormalisation::mean_camera(MeanCameraScale::LongLrm),
        near_far: NearFar { near: 0.5, far: 100.0 },
        disparity_planes: None,
        filters: Filters::default(),
        decode_limits: DecodeLimits::default(),
        allow_absent_images: false,
    }
}

fn entry(context: &[usize], target: &[usize]) -> IndexEntry {
    IndexEntry { context: context.to_vec(), target: target.to_vec(), overlap: None }
}

fn index(scenes: &[(&str, Vec<IndexEntry>)]) -> EvaluationIndex {
    EvaluationIndex { scenes: scenes.iter().map(|(key, entries)| ((*key).to_owned(), entries.clone())).collect() }
}

fn only_trial(scene: Scene, entry: IndexEntry, recipe: TrialRecipe) -> Result<(Trial, TargetImages), Skipped> {
    let index = index(&[(scene.key.clone().as_str(), vec![entry])]);
    let lazily = Prefetch { trials: 0, ..Prefetch::default() };
    Trials::new(Arc::new(MemorySource::new([scene])), &index, recipe, lazily).next().unwrap()
}

/// The second of three scenes has two entries, the first of which has no trial.
#[test]
fn a_part_of_an_index_keeps_the_positions_of_the_whole() {
    let one = || vec![entry(&[2, 6], &[4])];
    let whole = index(&[("c", one()), ("b", vec![entry(&[2, 60], &[4]), entry(&[2, 6], &[4])]), ("a", one())]);
    let part = EvaluationIndex { scenes: whole.scenes.iter().skip(1).map(|(k, e)| (k.clone(), e.clone())).collect() };
    let trials = |index: &EvaluationIndex| {
        let source = MemorySource::new(["a", "b", "c"].map(|key| scene(key, 9, 5)));
        Trials::new(Arc::new(source), index, recipe(), Prefetch::default())
    };
    let found = |trials: Trials| {
        let found = trials.filter_map(Result::ok);
        found.map(|(trial, _)| (trial.scene().to_owned(), trial.entry_number(), trial.position())).collect::<Vec<_>>()
    };
    let [c, b, a] = [("c", 0, 0), ("b", 1, 2), ("a", 0, 3)].map(|(key, entry, at)| (key.to_owned(), entry, at));
    assert_eq!(found(trials(&whole)), [c, b.clone(), a.clone()]);
    assert_eq!(found(trials(&part).at_positions(&whole.first_positions())), [b, a]);
    let alone: Vec<usize> = found(trials(&part)).into_iter().map(|(.., at)| at).collect();
    assert_eq!(alone, [1, 2]);
}

/// What a loader of a format without lenses reads: the same trial, from the same data.
#[test]
fn an_ignored_lens_leaves_no_trace() {
    let trial = |bent: bool, lens_distortion| {
        let mut scene = scene("s", 9, 5);
        if bent {
            let lens = Distortion::OpenCv { k1: 0.05, k2: 0.0, k3: 0.0, p1: 0.0, p2: -0.01 };
            scene.frames.iter_mut().for_each(|frame| frame.camera.distortion = lens);
        }
        let recipe = TrialRecipe { lens_distortion, ..recipe() };
        only_trial(scene, entry(&[2, 6], &[0, 8]), recipe).unwrap().0
    };
    let straight = trial(false, LensDistortion::Used);
    let [used, ignored] = [LensDistortion::Used, LensDistortion::Ignored].map(|lens| trial(true, lens));
    let lenses = |trial: &Trial| -> Vec<bool> {
        let targets = trial.targets().iter().map(|view| view.camera);
        let cameras = trial.context().iter().map(|view| view.camera).chain(targets);
        cameras.map(|camera| camera.distortion == Distortion::None).collect()
    };
    assert_eq!((lenses(&used), lenses(&ignored)), (vec![false; 4], vec![true; 4]));
    assert_eq!(ignored.hash(), straight.hash());
    assert_ne!(used.hash(), straight.hash());
}

#[test]
fn a_trial_holds_normalised_cameras_and_preprocessed_images() {
    let (trial, images) = only_trial(scene("s", 9, 5), entry(&[2, 6], &[0, 2, 8]), recipe()).unwrap();
    assert_eq!(trial.context().iter().map(|view| view.frame).collect::<Vec<_>>(), [2, 6]);
    let centres = trial.context().iter().map(|view| view.camera.camera_from_world.inverse().centre().x.abs());
    let largest = centres.fold(0.0, |a: f64, b| if b > a { b } else { a });
    Tolerance::absolute(0.02).assert([largest], [1.0], "Long-LRM scales the context to ±1");
    Tolerance::F64.assert([trial.context()[0].camera.intrinsics.fx], [0.8 * 2.0], "cropped to half the width");
    let labels: Vec<_> = trial.targets().iter().map(|view| (view.label.signed_distance, view.label.leaked)).collect();
    assert_eq!(labels, [(-2, false), (0, true), (2, false)]);
    assert_eq!(trial.context()[0].camera, trial.targets()[1].camera, "one frame, one camera");
    let given = trial.context()[1].image().unwrap();
    assert_eq!(((given.width(), given.height()), given.pixel(3, 3)), ((32, 32), Some([6, 5, 7])));
    assert_eq!(images.get(2).unwrap().unwrap().pixel(0, 0), Some([8, 5, 7]));
    assert!(Arc::ptr_eq(&trial.context()[0].image().unwrap(), &images.get(1).unwrap().unwrap()), "decoded once");
    assert_eq!((images.len(), images.trial(), images.get(3).is_none()), (3, trial.hash(), true));
}

#[test]
fn trials_say_which_entry_they_are_of() {
    let source = MemorySource::new([scene("a", 9, 5), scene("b", 9, 6)]);
    let entries = [vec![entry(&[2, 6], &[4])], vec![entry(&[1, 7], &[4]), entry(&[0, 8], &[3]), entry(&[0, 5], &[2])]];
    let [a, b] = entries.clone();
    let trials = Trials::new(Arc::new(source), &index(&[("a", a), ("b", b)]), recipe(), Prefetch::default());
    let trials: Vec<Trial> = trials.map(|trial| trial.unwrap().0).collect();
    let found: Vec<_> = trials.iter().map(|trial| (trial.scene(), trial.entry_number())).collect();
    assert_eq!(found, [("a", 0), ("b", 0), ("b", 1), ("b", 2)]);
    assert!(trials.iter().map(Trial::entry).eq(entries.iter().flatten()));
}

#[test]
fn near_and_far_follow_the_baseline() {
    let by_baseline = TrialRecipe { pose_normalisation: PoseNormalisation::pixelsplat(), ..recipe() };
    let (trial, _) = only_trial(scene("s", 9, 5), entry(&[2, 6], &[4]), by_baseline).unwrap();
    let near_far = trial.near_far();
    Tolerance::F64.assert([near_far.near, near_far.far], [0.25, 50.0], "a baseline of two units");
}

/// Of poses normalised to a baseline of 1, whatever it was.
#[test]
fn planes_by_disparity_replace_the_stated_ones() {
    let disparity_planes = Some(DisparityPlanes { near_sides: 3.0, far_pixels: 0.5 });
    let by_disparity =
        TrialRecipe { pose_normalisation: PoseNormalisation::pixelsplat(), disparity_planes, ..recipe() };
    let planes = |context: [usize; 2]| {
        let (trial, _) = only_trial(scene("s", 9, 5), entry(&context, &[4]), by_disparity.clone()).unwrap();
        let (camera, size) = (trial.context()[0].camera.intrinsics, trial.context()[0].size);
        let [x, y] = [f64::from(size.width) * camera.fx, f64::from(size.height) * camera.fy].map(f64::recip);
        let pixel = f64::midpoint(x, y);
        let shorter = f64::from(size.width.min(size.height));
        let found = trial.near_far();
        Tolerance::relative(1e-9).assert(
            [found.near * 3.0 * shorter, found.far * 0.5],
            [1.0 / pixel; 2],
            "a baseline of 1",
        );
        found
    };
    let [wide, narrow] = [planes([2, 6]), planes([3, 5])];
    Tolerance::relative(1e-9).assert([wide.near, wide.far], [narrow.near, narrow.far], "four units and two");
}

/// One scene for every reason, and a valid scene that is not affected by them.
#[test]
fn entries_are_skipped_by_reason_without_affecting_others() {
    let with = |key: &str, change: &dyn Fn(&mut Scene)| {
        let mut changed = scene(key, 9, 1);
        change(&mut changed);
        changed
    };
    let strict = TrialRecipe {
        preprocessing: Preprocessing { expected_size: Some(SIZE), ..recipe().preprocessing },
        filters: Filters {
            max_fov_degrees: Some(100.0),
            determinant: true,
            max_translation: Some(1e3),
            min_baseline: Some(1e-3),
            max_baseline: None,
        },
        ..recipe()
    };
    let source = MemorySource::new([
        scene("fine", 9, 0),
        with("absent", &|scene| scene.frames[4].image = FrameImage::Absent),
        with("missing", &|scene| scene.frames[4].image = FrameImage::Missing("4.png".into())),
        with("garbled", &|scene| scene.frames[4].image = FrameImage::Encoded(SharedBytes::new(b"no image".to_vec()))),
        with("wide", &|scene| {
            scene.frames[8].camera.intrinsics = NormalizedIntrinsics::new(0.1, 0.1, 0.5, 0.5).unwrap();
        }),
        with("far", &|scene| scene.frames[4].camera = camera(1e4)),
        with("still", &|scene| scene.frames[6].camera = scene.frames[2].camera),
        scene("short", 6, 0),
    ]);
    let keys = ["null", "elsewhere", "absent", "missing", "garbled", "wide", "far", "still", "short", "fine"];
    let entries = |key: &&str| if *key == "null" { Vec::new() } else { vec![entry(&[2, 6], &[4])] };
    let scenes: Vec<(&str, Vec<IndexEntry>)> = keys.iter().map(|key| (*key, entries(key))).collect();
    let mut trials = Trials::new(Arc::new(source), &index(&scenes), strict, Prefetch::default());
    assert_eq!(trials.len(), 9);
    let outcomes: Vec<Option<SkipReason>> = trials.by_ref().map(|trial| trial.err().map(|s| s.reason)).collect();
    let expected = [
        DropReason::SceneMissing,
        DropReason::ImageMissing,
        DropReason::ImageMissing,
        DropReason::FieldOfView,
        DropReason::Translation,
        DropReason::Baseline,
        DropReason::FrameOutOfRange,
    ]
    .map(SkipReason::Dropped);
    assert_eq!(outcomes[..3], expected[..3].iter().copied().map(Some).collect::<Vec<_>>());
    assert_eq!(outcomes[3], Some(SkipReason::ImageUnreadable));
    assert_eq!(outcomes[4..8], expected[3..].iter().copied().map(Some).collect::<Vec<_>>());
    assert_eq!(outcomes[8], None);
    let report = trials.report();
    assert_eq!((report.trials, report.skipped.len()), (1, 9), "the null scene is counted too");
    assert_eq!(report.counts()[&SkipReason::Dropped(DropReason::ImageMissing)], 2);
    assert_eq!(report.counts()[&SkipReason::NullEntry], 1);
    assert_eq!(trials.warnings().count(WarningKind::SceneNotFound), 1);
    assert_eq!(trials.warnings().count(WarningKind::LensDistortion), 8, "once for each scene that was loaded");
}

#[test]
fn mismatched_sizes_steps_and_cameras_are_skipped() {
    let other = ImageSize { width: 640, height: 360 };
    let expecting = Preprocessing { expected_size: Some(other), ..recipe().preprocessing };
    let reason = |preprocessing| {
        let recipe = TrialRecipe { preprocessing, ..recipe() };
        only_trial(scene("s", 9, 5), entry(&[2, 6], &[4]), recipe).unwrap_err().reason
    };
    assert_eq!(reason(expecting), SkipReason::Dropped(DropReason::ImageSize));
    assert_eq!(reason(Preprocessing::of([Step::from(CentreCrop::new(100, 100))])), SkipReason::Preprocessing);
    let coincident = TrialRecipe { pose_normalisation: PoseNormalisation::pixelsplat(), ..recipe() };
    let skipped = only_trial(scene("s", 9, 5), entry(&[2, 2], &[4]), coincident).unwrap_err();
    assert_eq!(skipped.reason, SkipReason::Dropped(DropReason::Baseline));
    let skipped = only_trial(scene("s", 9, 5), entry(&[], &[4]), recipe()).unwrap_err();
    assert_eq!(skipped.reason, SkipReason::PoseNormalisation);
}

/// The test's cameras are for images of 64×48; crops of another shape are rejected with scene, frame and both sizes.
#[test]
fn rejects_images_that_do_not_fit_their_intrinsics() {
    let any_size = TrialRecipe { preprocessing: Preprocessing::default(), ..recipe() };
    let with = |width: u32, height: u32, stated: Option<ImageSize>| {
        let mut changed = scene("s", 9, 5);
        changed.frames.iter_mut().for_each(|frame| frame.stated_size = Some(SIZE));
        let image = atsplat_pixels::ImageU8::new(width, height, vec![7; (width * height * 3) as usize]).unwrap();
        changed.frames[6].image = FrameImage::Encoded(SharedBytes::new(atsplat_pixels::encode_png(&image).unwrap()));
        changed.frames[6].stated_size = stated;
        let index = index(&[("s", vec![entry(&[2, 6], &[4])])]);
        let mut trials =
            Trials::new(Arc::new(MemorySource::new([changed])), &index, any_size.clone(), Prefetch::default());
        let outcome = trials.next().unwrap().map(drop);
        (outcome, trials.warnings().count(WarningKind::UnexpectedSize))
    };
    for (width, height, stated, fitting) in [
        (48, 48, None, "60×48"),
        (48, 64, None, "80×64"),
        (48, 48, Some(SIZE), "64×48"),
        (48, 64, Some(SIZE), "64×48"),
        (64, 40, Some(SIZE), "64×48"),
    ] {
        let (outcome, counted) = with(width, height, stated);
        let skipped = outcome.unwrap_err();
        assert_eq!((skipped.reason, skipped.scene.as_str(), counted), (SkipReason::ImageMisfit, "s", 1));
        let detail = &skipped.detail;
        assert!(!detail.contains("EXIF"), "{detail}");
        assert!(detail.contains("frame 6") && detail.contains(&format!("{width}×{height}")), "{detail}");
        assert!(detail.contains(fitting), "{detail}");
    }
    assert_eq!(with(128, 96, Some(SIZE)), (Ok(()), 0));
}

/// For the test's cameras, images of 50×40 would have square pixels. Those of 40×40 are a warning if the protocol expects this size.
#[test]
fn images_of_the_expected_size_may_have_other_pixels() {
    let (width, height) = (40, 40);
    let image = atsplat_pixels::ImageU8::new(width, height, vec![7; (width * height * 3) as usize]).unwrap();
    let png = SharedBytes::new(atsplat_pixels::encode_png(&image).unwrap());
    let outcome = |expected_size: Option<ImageSize>, stated: Option<ImageSize>| {
        let mut changed = scene("s", 9, 5);
        for frame in &mut changed.frames {
            (frame.image, frame.stated_size) = (FrameImage::Encoded(png.clone()), stated);
        }
        let recipe =
            TrialRecipe { preprocessing: Preprocessing { expected_size, ..Preprocessing::default() }, ..recipe() };
        let index = index(&[("s", vec![entry(&[2, 6], &[4])])]);
        let mut trials = Trials::new(Arc::new(MemorySource::new([changed])), &index, recipe, Prefetch::default());
        let reason = trials.next().unwrap().err().map(|skipped| skipped.reason);
        (reason, trials.warnings().count(WarningKind::UnexpectedSize))
    };
    let size = ImageSize { width, height };
    assert_eq!(outcome(None, None), (Some(SkipReason::ImageMisfit), 3));
    assert_eq!(outcome(Some(size), None), (None, 3));
    // They are for images of another size, as the data say.
    assert_eq!(outcome(Some(size), Some(SIZE)), (Some(SkipReason::ImageMisfit), 3));
}

/// A JPEG of this many columns and rows as stored, which EXIF rotates by 90° clockwise.
fn rotated_jpeg(width: u32, height: u32) -> FrameImage {
    let exif = b"Exif\0\0MM\0\x2a\0\0\0\x08\0\x01\x01\x12\0\x03\0\0\0\x01\0\x06\0\0\0\0\0\0";
    let image = atsplat_pixels::ImageU8::new(width, height, vec![7; (width * height * 3) as usize]).unwrap();
    let mut jpeg = atsplat_pixels::encode_jpeg(&image, 90).unwrap();
    let length = u16::try_from(exif.len() + 2).unwrap().to_be_bytes();
    jpeg.splice(2..2, [&[0xff, 0xe1], &length[..], exif].concat());
    FrameImage::Encoded(SharedBytes::new(jpeg))
}

/// Only the rotated image would fit its camera.
#[test]
fn a_misfit_says_that_exif_rotates_the_image() {
    let mut changed = scene("s", 9, 5);
    (changed.frames[6].image, changed.frames[6].stated_size) = (rotated_jpeg(48, 64), Some(SIZE));
    let recipe = TrialRecipe { preprocessing: Preprocessing::default(), ..recipe() };
    let skipped = only_trial(changed, entry(&[2, 6], &[4]), recipe).map(drop).unwrap_err();
    let Skipped { reason, detail, frame, .. } = skipped;
    let hint = "; the image is rotated 90° clockwise by EXIF, and the stored pixels are used";
    assert!((reason, frame) == (SkipReason::ImageMisfit, Some(6)) && detail.ends_with(hint), "{frame:?}, {detail}");
    assert!(detail.contains("frame 6") && detail.contains("found 48×64"), "{detail}");
}

#[test]
fn warns_about_images_with_an_exif_rotation() {
    let mut rotated = scene("s", 9, 5);
    rotated.frames[6].image = rotated_jpeg(64, 48);
    let index = index(&[("s", vec![entry(&[2, 6], &[4])])]);
    let mut trials = Trials::new(Arc::new(MemorySource::new([rotated])), &index, recipe(), Prefetch::default());
    let (trial, _) = trials.next().unwrap().unwrap();
    assert_eq!(trial.context()[1].image().unwrap().width(), 32, "as stored");
    assert_eq!(trials.warnings().count(WarningKind::TurnedImage), 1);
    let warning = trials.warnings().kept().iter().find(|warning| warning.kind == WarningKind::TurnedImage).unwrap();
    assert!(
        warning.to_string().contains("s: frame 6: rotated 90° clockwise by EXIF; the stored pixels are used"),
        "{warning}"
    );
}

#[test]
fn warns_about_an_alpha_channel_and_low_bytes_that_are_dropped() {
    use image::{ExtendedColorType, ImageEncoder as _, codecs::png::PngEncoder};
    let index = index(&[("s", vec![entry(&[2, 6], &[4])])]);
    let deep: Vec<u8> = [0x0980u16, 0x0880, 0x0780].iter().flat_map(|sample| sample.to_ne_bytes()).collect();
    for (pixel, colour, kind, expected) in [
        (
            vec![9, 8, 7, 255],
            ExtendedColorType::Rgba8,
            WarningKind::DroppedAlpha,
            "s: frame 6: it has an alpha channel, which is dropped",
        ),
        (deep, ExtendedColorType::Rgb16, WarningKind::DroppedLowBytes, "s: frame 6: its samples have 16 bits"),
    ] {
        let mut png = Vec::new();
        PngEncoder::new(&mut png).write_image(&pixel.repeat(64 * 48), 64, 48, colour).unwrap();
        let mut with_more = scene("s", 9, 5);
        with_more.frames[6].image = FrameImage::Encoded(SharedBytes::new(png));
        let mut trials = Trials::new(Arc::new(MemorySource::new([with_more])), &index, recipe(), Prefetch::default());
        let (trial, _) = trials.next().unwrap().unwrap();
        assert_eq!(trial.context()[1].image().unwrap().samples()[..3], [9, 8, 7], "{kind}");
        assert_eq!(trials.warnings().count(kind), 1, "{kind}: the other frames have none");
        let kept = trials.warnings().kept().iter().find(|warning| warning.kind == kind).unwrap();
        assert!(kept.to_string().starts_with(expected), "{kept}");
    }
}

/// An image truncated after its header: the trial is valid, and requesting the image gives the same error every time.
#[test]
fn a_damaged_image_is_an_error_when_requested() {
    let mut damaged = scene("s", 9, 5);
    let mut bytes = png([1, 2, 3]);
    bytes.truncate(50);
    damaged.frames[4].image = FrameImage::Encoded(SharedBytes::new(bytes));
    for trials in [0, 3] {
        let index = index(&[("s", vec![entry(&[2, 6], &[4, 5])])]);
        let source = Arc::new(MemorySource::new([damaged.clone()]));
        let prefetch = Prefetch { trials, ..Prefetch::default() };
        let (_, images) = Trials::new(source, &index, recipe(), prefetch).next().unwrap().unwrap();
        let error = images.get(0).unwrap().unwrap_err();
        assert!(matches!(error, ProtocolError::Image(_)), "{error}");
        assert_eq!(error.to_string(), images.get(0).unwrap().unwrap_err().to_string());
        assert!(error.to_string().contains("frame 4"), "{error}");
        assert!(images.get(1).unwrap().is_ok());
    }
}

#[test]
fn a_bare_trajectory_gives_trials_only_if_allowed() {
    let mut bare = scene("s", 9, 5);
    bare.frames.iter_mut().for_each(|frame| frame.image = FrameImage::Absent);
    let allowing = TrialRecipe {
        preprocessing: Preprocessing { expected_size: Some(SIZE), ..recipe().preprocessing },
        allow_absent_images: true,
        ..recipe()
    };
    let (trial, images) = only_trial(bare.clone(), entry(&[2, 6], &[4]), allowing.clone()).unwrap();
    assert!(trial.context()[0].image().is_err() && images.get(0).unwrap().is_err());
    let (with_images, _) = only_trial(scene("s", 9, 5), entry(&[2, 6], &[4]), allowing).unwrap();
    assert_eq!(trial.hash(), with_images.hash());
}

#[test]
fn hashes_distinguish_trials_and_ignore_images_and_overlap() {
    let base = || (scene("s", 9, 5), entry(&[2, 6], &[4]), recipe());
    let hashes = |(scene, entry, recipe): (Scene, IndexEntry, TrialRecipe)| {
        let (trial, _) = only_trial(scene, entry, recipe).unwrap();
        (trial.hash(), trial.pose_hash())
    };
    let reference = hashes(base());
    let mut same = base();
    same.0.frames[4].image = FrameImage::Encoded(SharedBytes::new(png([9, 9, 9])));
    same.0.frames[0].camera = camera(77.0);
    same.1.overlap = Some(0.5.into());
    assert_eq!(hashes(same), reference, "pixels, other frames and overlap are ignored");
    let mut rounded = base();
    rounded.0.frames[2].camera.intrinsics.cx += 1e-12;
    assert_eq!(hashes(rounded), reference, "cameras are hashed as f32");

    let mut renamed = base();
    renamed.0.key.push('2');
    let mut replaced = base();
    replaced.2.pose_normalisation = PoseNormalisation::None;
    let mut recropped = base();
    recropped.2.preprocessing = Preprocessing::of([Step::from(CentreCrop::new(32, 30))]);
    let mut nearer = base();
    nearer.2.near_far.near = 0.25;
    let mut bent = base();
    bent.0.frames[4].camera.distortion = Distortion::OpenCv { k1: 1e-3, k2: 0.0, k3: 0.0, p1: 0.0, p2: 0.0 };
    let mut by_disparity = base();
    by_disparity.2.disparity_planes = Some(DisparityPlanes { near_sides: 3.0, far_pixels: 0.5 });
    let changes = [
        ("key", renamed),
        ("rule", replaced),
        ("crop", recropped),
        ("near", nearer),
        ("disparity", by_disparity),
        ("lens of a target", bent),
    ];
    for (what, changed) in changes {
        let changed = hashes(changed);
        assert_ne!(changed.0, reference.0, "{what}");
        assert_eq!(changed.1, reference.1, "{what} is not part of the poses");
    }
    let mut swapped = base();
    swapped.1 = entry(&[6, 2], &[4]);
    let mut moved = base();
    moved.0.frames[4].camera = camera(2.001);
    let mut context_not_target = base();
    context_not_target.1 = entry(&[2, 6, 4], &[]);
    for (what, changed) in [("order", swapped), ("pose", moved), ("side", context_not_target)] {
        let changed = hashes(changed);
        assert_ne!(changed.0, reference.0, "{what}");
        assert_ne!(changed.1, reference.1, "{what}");
    }
}

type Change<'a> = &'a dyn Fn(&mut NormalizedIntrinsics);

/// Each intrinsic on its own, of a context and of a target camera.
#[test]
fn intrinsics_change_the_trial_hash_but_not_the_pose_hash() {
    let hashes = |frame: usize, change: &dyn Fn(&mut NormalizedIntrinsics)| {
        let mut changed = scene("s", 9, 5);
        change(&mut changed.frames[frame].camera.intrinsics);
        let (trial, _) = only_trial(changed, entry(&[2, 6], &[4]), recipe()).unwrap();
        (trial.hash(), trial.pose_hash())
    };
    let reference = hashes(2, &|_| ());
    let changes: [(&str, Change<'_>); 4] =
        [("fx", &|k| k.fx += 1e-4), ("fy", &|k| k.fy += 1e-4), ("cx", &|k| k.cx += 1e-4), ("cy", &|k| k.cy += 1e-4)];
    let mut seen = vec![reference.0];
    for frame in [2, 4] {
        for (name, change) in changes {
            let (hash, pose_hash) = hashes(frame, change);
            assert!(!seen.contains(&hash), "{name} of frame {frame}");
            assert_eq!(pose_hash, reference.1, "{name} of frame {frame} is not part of the poses");
            seen.push(hash);
        }
    }
}

/// Stored results contain the hash, so changing it changes their format. The expected values are computed independently,
/// from the documented layout, by `tests/fixtures/make_trial_hash.py`.
#[test]
fn hashes_follow_the_documented_layout() {
    let mut one = scene("scène", 3, 5);
    for (number, frame) in one.frames.iter_mut().enumerate() {
        frame.camera = Camera::pinhole(
            atsplat_camera::CameraFromWorld::new(
                glam::DMat3::IDENTITY,
                glam::DVec3::new(-(number as f64) * 0.1, -0.0, 0.25),
            )
            .unwrap(),
            NormalizedIntrinsics::new(0.8, 1.0, 0.5, 0.5).unwrap(),
        );
    }
    one.frames[1].camera.distortion = Distortion::OpenCv { k1: 0.01, k2: -0.02, k3: 0.03, p1: 0.001, p2: -0.002 };
    one.frames[2].camera.distortion = Distortion::Fisheye { k: [0.1, 0.2, -0.3, 0.4] };
    let trial = |disparity_planes| {
        let recipe = TrialRecipe { pose_normalisation: PoseNormalisation::None, disparity_planes, ..recipe() };
        only_trial(one.clone(), entry(&[0, 2], &[1]), recipe).unwrap().0
    };
    let by_disparity = trial(Some(DisparityPlanes { near_sides: 3.0, far_pixels: 0.5 }));
    let trial = trial(None);
    let oracle: serde_json::Value =
        serde_json::from_str(include_str!("../../tests/fixtures/trial_hash_oracle.json")).unwrap();
    assert_eq!(trial.preprocessing().to_string(), oracle["preprocessing"].as_str().unwrap());
    assert_eq!(trial.hash().to_string(), oracle["hash"].as_str().unwrap());
    assert_eq!(by_disparity.hash().to_string(), oracle["hash_by_disparity"].as_str().unwrap());
    assert_eq!(trial.pose_hash().to_string(), oracle["pose_hash"].as_str().unwrap());
}
