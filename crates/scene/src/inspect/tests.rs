use std::path::PathBuf;
use std::sync::atomic::{AtomicUsize, Ordering};

use atsplat_camera::{Camera, CameraFromWorld, Distortion, ImageSize};
use atsplat_numeric::Tolerance;
use atsplat_pixels::DecodeLimits;
use atsplat_tests::on_threads;

use super::*;
use crate::checks::cut_short::PNG_END;
use crate::test_source::{TestSource, camera_at, frame, rotated_camera_at, scene, wandering_scene};
use crate::{FrameImage, SharedBytes};

fn inspected(source: &TestSource, options: InspectOptions) -> (Inspection, Warnings) {
    let (mut warnings, steps) = (Warnings::new(), AtomicUsize::new(0));
    let step = || {
        steps.fetch_add(1, Ordering::Relaxed);
    };
    let report = inspect(source, Format::Re10k, &options, &mut warnings, &step);
    assert_eq!(steps.into_inner(), source.keys().len(), "one step a scene");
    (report, warnings)
}

/// A PNG with nothing between its size and its end.
fn png(width: u32, height: u32) -> FrameImage {
    let mut bytes = b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR".to_vec();
    bytes.extend([width.to_be_bytes(), height.to_be_bytes()].concat());
    bytes.extend([8, 2, 0, 0, 0, 0, 0, 0, 0]);
    bytes.extend(PNG_END);
    FrameImage::Encoded(SharedBytes::new(bytes))
}

/// Steps of 1, 2 and 3 along x; a single camera; a rotation by 30° in place.
fn small_dataset() -> TestSource {
    let line = scene("line", [0.0, 1.0, 3.0, 6.0].map(|x| camera_at([x, 0.0, 0.0])));
    let lone = scene("lone", [camera_at([5.0, 5.0, 5.0])]);
    let turn = scene("turn", [0.0, 30.0].map(|angle| rotated_camera_at([0.0; 3], angle)));
    TestSource::new([line, lone, turn])
}

#[track_caller]
fn assert_summary(summary: Summary, count: u64, [min, median, max]: [f64; 3], what: &str) {
    assert_eq!((summary.count, summary.non_finite), (count, 0), "{what}");
    let found = [summary.min, summary.median, summary.max].map(|value| value.unwrap_or(f64::NAN));
    Tolerance::absolute(1e-9).assert(found, [min, median, max], what);
}

#[test]
fn baselines_match_a_computation_by_hand() {
    let (report, _) = inspected(&small_dataset(), InspectOptions { per_scene: true, ..InspectOptions::default() });
    let b = report.baselines;
    assert_summary(b.step, 4, [0.0, 1.5, 3.0], "steps 1, 2, 3 and 0");
    assert_summary(b.rotation_degrees, 4, [0.0, 0.0, 30.0], "one rotation among four");
    assert_summary(b.scene_step, 2, [0.0, 1.0, 2.0], "medians 2 and 0; the single camera has none");
    assert_summary(b.scene_rotation_degrees, 2, [0.0, 15.0, 30.0], "medians 0 and 30");
    assert_summary(b.extent, 3, [0.0, 0.0, 3.5], "the line's mean is at 2.5");
    assert_summary(b.path_length, 3, [0.0, 0.0, 6.0], "paths");
    assert!(b.path_length.min.is_some_and(f64::is_sign_positive), "the path length of a single camera is 0, not −0");
    assert_summary(report.frames_per_scene, 3, [1.0, 2.0, 4.0], "frames");
    let steps: Vec<_> = report.per_scene.iter().map(|scene| (scene.key.as_str(), scene.frames, scene.step)).collect();
    assert_eq!(steps, [("line", 4, Some(2.0)), ("lone", 1, None), ("turn", 2, Some(0.0))]);
}

/// Of the line's cameras one in the middle has no pose: neither adjacent step is measured, and its centre is not that of a camera.
#[test]
fn frames_without_a_pose_are_counted_and_not_measured() {
    let mut line = scene("line", [0.0, 1.0, 100.0, 3.0, 6.0].map(|x| camera_at([x, 0.0, 0.0])));
    line.frames[2].image = FrameImage::Absent.unposed("its rotation is none");
    line.frames[2].camera.camera_from_world = CameraFromWorld::UNKNOWN;
    let (report, _) = inspected(&TestSource::new([line]), InspectOptions::default());
    let b = report.baselines;
    assert_summary(b.step, 2, [1.0, 2.0, 3.0], "steps 1 and 3");
    assert_summary(b.extent, 1, [3.5; 3], "the mean of four is at 2.5");
    assert_summary(b.path_length, 1, [4.0; 3], "the measured steps");
    assert_eq!((report.frames, report.images.absent, report.images.unposed), (5, 4, 1));
    assert!(!report.is_complete());
    assert!(report.to_string().contains("images    1 without a usable pose, 4 without an image\n"), "{report}");
}

#[test]
fn reports_intrinsics_and_field_of_view() {
    let (report, _) = inspected(&small_dataset(), InspectOptions::default());
    assert_summary(report.intrinsics.fx, 7, [0.5; 3], "fx");
    assert_summary(report.intrinsics.fov_x_degrees, 7, [90.0; 3], "twice the arctangent of 0.5 / 0.5");
    assert_summary(report.intrinsics.fov_y_degrees, 7, [2.0 * (0.5f64 / 0.9).atan().to_degrees(); 3], "field of view");
    assert!(report.per_scene.is_empty(), "not requested");
}

#[test]
fn small_rotations_are_not_rounded_away() {
    let turn = scene("turn", [0.0, 1e-7].map(|angle| rotated_camera_at([0.0; 3], angle)));
    let (report, _) = inspected(&TestSource::new([turn]), InspectOptions::default());
    let angle = report.baselines.rotation_degrees.max.unwrap();
    Tolerance::relative(1e-6).assert([angle], [1e-7], "an arccosine would give 0 or 1.2e-6");
}

#[test]
fn baselines_are_invariant_under_rigid_motions_of_the_world() {
    let source = TestSource::new([wandering_scene("a", 30), wandering_scene("b", 7)]);
    let (before, _) = inspected(&source, InspectOptions::default());
    let (after, _) = inspected(&source.moved(), InspectOptions::default());
    let numbers = |report: &Inspection| {
        let b = report.baselines;
        [b.step, b.rotation_degrees, b.scene_step, b.scene_rotation_degrees, b.extent, b.path_length]
            .into_iter()
            .flat_map(|s| [s.min, s.median, s.max])
            .map(Option::unwrap)
            .collect::<Vec<_>>()
    };
    Tolerance { absolute: 1e-9, relative: 1e-9 }.assert(numbers(&after), numbers(&before), "baselines");
}

/// A scene with every kind of image problem, and a scene that cannot be read.
fn dataset_with_problems() -> TestSource {
    let mut images = wandering_scene("images", 6);
    let stated = ImageSize { width: 640, height: 360 };
    for (frame, image) in images.frames.iter_mut().zip([
        png(64, 36),
        FrameImage::Missing(PathBuf::from("images/2.png")),
        png(64, 64),
        FrameImage::Encoded(SharedBytes::new(b"no image at all".to_vec())),
        FrameImage::Encoded(SharedBytes::new(b"\x89PNG\r\n\x1a\n cut short".to_vec())),
        png(64, 36),
    ]) {
        frame.image = image;
        frame.stated_size = Some(stated);
    }
    images.frames[5].camera.distortion = Distortion::Fisheye { k: [0.1, 0.0, 0.0, 0.0] };
    TestSource::new([wandering_scene("broken", 3), images, wandering_scene("poses only", 4)]).with_unreadable("broken")
}

#[test]
fn problems_are_counted_by_kind() {
    let all = InspectOptions { sizes: SizeSampling::All, per_scene: false };
    let (report, warnings) = inspected(&dataset_with_problems(), all);
    assert_eq!(report.scenes, SceneCounts { listed: 3, read: 2, unreadable: 1, left_out: 0 });
    assert!(!report.is_complete());
    let expected = ImageCounts {
        encoded: 5,
        missing: 1,
        absent: 4,
        headers_read: 3,
        headers_unreadable: 2,
        unfit: 1,
        ..ImageCounts::default()
    };
    assert_eq!((report.frames, report.images), (10, expected));
    let size = |width, height, frames| SizeCount { size: ImageSize { width, height }, frames };
    assert_eq!(report.sizes, [size(64, 36, 2), size(64, 64, 1)]);
    assert_eq!(report.stated_sizes, [size(640, 360, 6)]);
    assert_eq!(report.lenses, LensCounts { pinhole: 9, opencv: 0, fisheye: 1 });
    for (kind, count) in [
        (WarningKind::UnexpectedSize, 1),
        (WarningKind::MixedSizes, 1),
        (WarningKind::UnreadableImage, 2),
        (WarningKind::UnreadableScene, 1),
    ] {
        assert_eq!(warnings.count(kind), count, "{kind}");
        assert!(report.problems.iter().any(|problem| problem.kind == kind && problem.count == count), "{kind}");
    }
}

/// One ignored next to the scenes, one in a chunk that is missing, a chunk that cannot be read, and a scene and a chunk that the
/// index does not list.
#[test]
fn scenes_that_were_left_out_make_an_inspection_incomplete() {
    let inspected = |kinds: &[WarningKind]| {
        let mut warnings = Warnings::new();
        for kind in kinds {
            warnings.push(*kind, "elsewhere", "detail");
        }
        inspect(&small_dataset(), Format::Re10k, &InspectOptions::default(), &mut warnings, &|| ())
    };
    let kinds = [
        WarningKind::IgnoredScene,
        WarningKind::SceneNotFound,
        WarningKind::UnreadableScene,
        WarningKind::UnindexedScene,
        WarningKind::UnindexedChunk,
    ];
    for kind in kinds {
        let report = inspected(&[kind]);
        assert_eq!((report.scenes.left_out, report.is_complete()), (1, false), "{kind}");
    }
    let report = inspected(&kinds);
    assert_eq!(report.scenes, SceneCounts { listed: 3, read: 3, unreadable: 0, left_out: 5 });
    assert!(report.to_string().contains("scenes    3 listed: 3 read; 5 left out\n"), "{report}");
    assert_eq!(serde_json::to_value(&report).unwrap()["scenes"]["left-out"], 5);
    let camera = inspected(&[WarningKind::BadCamera]);
    assert_eq!((camera.scenes.left_out, camera.is_complete()), (0, true));
}

/// Images of a rig have the same numbers at the end of their names.
#[test]
fn rows_that_are_lost_or_wrong_make_an_inspection_incomplete() {
    let is_complete = |format: Format, kind| {
        let mut warnings = Warnings::new();
        warnings.push(kind, "line", "detail");
        inspect(&small_dataset(), format, &InspectOptions::default(), &mut warnings, &|| ()).is_complete()
    };
    let kind = WarningKind::ImplausibleIntrinsics;
    assert_eq!(Format::ALL.map(|format| is_complete(format, kind)), [false; 4], "{kind}");
    assert!(is_complete(Format::Colmap, WarningKind::MixedSizes), "captures of two cameras have two sizes");
    for kind in [WarningKind::UnlistedImage, WarningKind::DuplicateTimestamp] {
        assert_eq!(Format::ALL.map(|format| is_complete(format, kind)), [false, false, true, true], "{kind}");
    }
    assert!(is_complete(Format::Re10k, WarningKind::UnorderedTimestamps));
}

/// Without a stated size, cameras have square pixels at 64×36. A run accepts those that are up to 10 % from square, with a warning.
#[test]
fn images_that_a_run_would_skip_make_an_inspection_incomplete() {
    for (width, unfit, warned) in [(64, 0, 0), (67, 0, 2), (61, 0, 2), (72, 2, 2), (36, 2, 2)] {
        let mut scene = wandering_scene("s", 2);
        scene.frames.iter_mut().for_each(|frame| frame.image = png(width, 36));
        let (report, warnings) = inspected(&TestSource::new([scene]), InspectOptions::default());
        assert_eq!((report.images.unfit, warnings.count(WarningKind::UnexpectedSize)), (unfit, warned), "{width}");
        assert_eq!(report.is_complete(), unfit == 0, "{width}: {report}");
    }
}

/// One warning a scene, with the first image that is not of the size of most, which may be the first of all.
#[test]
fn scenes_with_images_of_several_sizes_are_problems() {
    let with = |key: &str, widths: &[u32]| {
        let mut scene = wandering_scene(key, widths.len());
        for (frame, width) in scene.frames.iter_mut().zip(widths) {
            (frame.image, frame.stated_size) = (png(*width, 36), Some(ImageSize { width: *width, height: 36 }));
        }
        scene
    };
    let scenes =
        [with("a", &[64, 64, 64]), with("b", &[60, 64, 64, 62, 64]), with("c", &[64, 60]), with("d", &[60; 3])];
    let source = TestSource::new(scenes);
    let found = |sizes| {
        let (report, warnings) = inspected(&source, InspectOptions { sizes, per_scene: false });
        assert!(report.is_complete(), "{report}");
        warnings.kept().iter().map(ToString::to_string).collect::<Vec<_>>()
    };
    let expected = [
        "b: images of several sizes: 64×36 in 3 of 5, 60×36 in frame 0",
        "c: images of several sizes: 64×36 in 1 of 2, 60×36 in frame 1",
    ];
    assert_eq!(found(SizeSampling::All), expected);
    assert_eq!(found(SizeSampling::PerScene(3))[0], expected[0].replace("3 of 5", "2 of 3"), "frames 0, 2 and 4");
    assert!(found(SizeSampling::PerScene(1)).is_empty());
}

#[test]
fn image_sizes_are_read_from_files() {
    let folder = tempfile::tempdir().unwrap();
    let FrameImage::Encoded(bytes) = png(640, 360) else { unreachable!() };
    std::fs::write(folder.path().join("0.png"), &*bytes).unwrap();
    let mut scene = wandering_scene("files", 2);
    for (position, frame) in scene.frames.iter_mut().enumerate() {
        frame.image = FrameImage::File(folder.path().join(format!("{position}.png")));
    }
    let (report, _) = inspected(&TestSource::new([scene]), InspectOptions::default());
    let images = report.images;
    assert_eq!((images.files, images.headers_read, images.headers_unreadable), (2, 1, 1));
    assert_eq!(report.sizes, [SizeCount { size: ImageSize { width: 640, height: 360 }, frames: 1 }]);
}

/// Every file is looked at, but only the sampled ones are read: of the frames with content 0, 3 and 7.
#[test]
fn files_that_are_empty_or_cut_short_are_problems() {
    let folder = tempfile::tempdir().unwrap();
    let FrameImage::Encoded(bytes) = png(640, 360) else { unreachable!() };
    let mut scene = wandering_scene("files", 8);
    for (position, frame) in scene.frames.iter_mut().enumerate() {
        let path = folder.path().join(format!("{position}.png"));
        let content = match position {
            1 | 6 => &bytes[..0],
            3 | 7 => &bytes[..bytes.len() - 1],
            _ => &bytes[..],
        };
        std::fs::write(&path, content).unwrap();
        frame.image = FrameImage::File(path);
    }
    let source = TestSource::new([scene]);
    for (sizes, cut) in [(SizeSampling::PerScene(0), 0), (SizeSampling::PerScene(3), 2), (SizeSampling::All, 2)] {
        let (report, warnings) = inspected(&source, InspectOptions { sizes, per_scene: true });
        let images = report.images;
        assert_eq!((images.files, images.empty, images.cut_short), (6, 2, cut), "{sizes:?}");
        assert_eq!((images.headers_unreadable, report.per_scene[0].images, report.is_complete()), (0, 6, false));
        let counts = [WarningKind::EmptyImage, WarningKind::UnreadableImage].map(|kind| warnings.count(kind));
        assert_eq!(counts, [2, cut], "{sizes:?}");
        let first = &warnings.kept()[0];
        let path = folder.path().join("1.png");
        assert_eq!(first.detail, format!("frame 1: the file is empty ({})", path.display()));
        assert!(report.to_string().contains("images    6 in files, 2 empty\n"), "{report}");
    }
    let (_, warnings) = inspected(&source, InspectOptions::default());
    let detail = &warnings.kept()[2].detail;
    assert!(detail.starts_with("frame 3: cut short: a PNG of 44 bytes") && detail.contains("3.png"), "{detail}");
}

/// An image is named by its file, or that of its chunk, if that is known.
#[test]
fn unreadable_images_are_named() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("2166667.png");
    std::fs::write(&path, b"\x89PNG\r\n\x1a\n cut short").unwrap();
    let bytes = SharedBytes::new(std::fs::read(&path).unwrap());
    let mut frame = frame(0, camera_at([0.0; 3]));
    for (image, place) in [
        (FrameImage::File(path.clone()), path.display().to_string()),
        (FrameImage::Encoded(bytes.clone()), "in a chunk".to_owned()),
        (FrameImage::Encoded(bytes.in_file("test/000000.torch".as_ref())), "test/000000.torch".to_owned()),
    ] {
        frame.image = image;
        let limits = DecodeLimits::default();
        for message in [frame.size("s", 65).unwrap_err(), frame.decode("s", 65, &limits).unwrap_err()] {
            let message = message.to_string();
            assert!(message.starts_with("frame 65 of scene \"s\": PNG "), "{message}");
            assert!(message.ends_with(&format!(" ({place})")), "{message}");
        }
    }
}

/// Structure from motion placed one image of each of two cameras; of a third, the pose is unusable. A mask is no frame.
#[test]
fn images_that_no_frame_names_are_counted() {
    let folder = tempfile::tempdir().unwrap();
    let FrameImage::Encoded(bytes) = png(64, 36) else { unreachable!() };
    let below = |name: &str| folder.path().join(name);
    for name in ["left/0", "left/1", "left/2", "left/3", "left/dynamic_mask_0", "right/0", "right/2", "other/0"] {
        atsplat_tests::write_file(&below(name).with_extension("png"), &*bytes);
    }
    let mut scene = wandering_scene("capture", 4);
    let [left, right, unposed] = ["left/0.png", "right/0.png", "left/2.png"].map(|name| FrameImage::File(below(name)));
    let (unposed, missing) = (unposed.unposed("its rotation is none"), FrameImage::Missing(below("left/9.png")));
    for (frame, image) in scene.frames.iter_mut().zip([left, right, unposed, missing]) {
        frame.image = image;
        frame.stated_size = Some(ImageSize { width: 64, height: 36 });
    }
    let (_, warnings) = inspected(&TestSource::new([scene.clone()]), InspectOptions::default());
    let of_kind = |warnings: &Warnings| -> Vec<String> {
        let unlisted = warnings.kept().iter().filter(|warning| warning.kind == WarningKind::UnlistedImage);
        unlisted.map(|warning| warning.detail.clone()).collect()
    };
    let expected = ["left/1.png", "left/3.png", "right/2.png"]
        .map(|name| format!("no frame belongs to {}", below(name).display()));
    assert_eq!(of_kind(&warnings), expected);
    // Of a trajectory, they are found when it is loaded.
    scene.frames[0].stated_size = None;
    let (_, warnings) = inspected(&TestSource::new([scene]), InspectOptions::default());
    assert_eq!(of_kind(&warnings), [""; 0]);
}

#[test]
fn frames_that_repeat_a_pose_are_counted_by_scene() {
    let moving = [0.0, 1.0, 3.0].map(|x| camera_at([x, 0.0, 0.0]));
    let still = [0.0, 2.0, 2.0, 2.0].map(|x| camera_at([x, 0.0, 0.0]));
    let (report, _) = inspected(&TestSource::new([scene("m", moving), scene("s", still)]), InspectOptions::default());
    let [problem] = report.problems.as_slice() else { panic!("{:?}", report.problems) };
    assert_eq!((problem.kind, problem.count), (WarningKind::RepeatedPose, 1));
    let expected = "s: 2 of 4 frames repeat an earlier pose, first frame 2 that of frame 1";
    assert_eq!(problem.examples[0].to_string(), expected);
    assert!(report.is_complete());
}

/// Their poses may have been lost. Of two frames, and of some of a scene's, that is no sign.
#[test]
fn a_scene_without_any_baseline_makes_an_inspection_incomplete() {
    let found = |cameras: &[Camera]| {
        let source = TestSource::new([wandering_scene("fine", 4), scene("s", cameras.iter().copied())]);
        let (report, _) = inspected(&source, InspectOptions::default());
        (report.scenes_in_one_place, report.is_complete())
    };
    let [a, b, c] = [0.0, 11.0, 37.0].map(|angle| rotated_camera_at([9.3, -4.1, 2.7], angle));
    let other = rotated_camera_at([9.3, -4.1, 2.8], 37.0);
    assert_eq!(found(&[a, b, c]), (1, false), "they turn");
    assert_eq!(found(&[b, b, b]), (1, false), "one pose");
    assert_eq!(found(&[a, b]), (0, true));
    assert_eq!(found(&[a, a, b, other]), (0, true), "they stand still at first");
}

#[test]
fn sampling_limits_the_headers_read() {
    let opened = |sizes| {
        let images = inspected(&dataset_with_problems(), InspectOptions { sizes, per_scene: false }).0.images;
        images.headers_read + images.headers_unreadable
    };
    assert_eq!(opened(SizeSampling::PerScene(0)), 0);
    assert_eq!(opened(SizeSampling::PerScene(2)), 2, "only one scene has images");
    assert_eq!(opened(SizeSampling::PerScene(100)), 5);
}

#[test]
fn numbers_that_overflow_are_counted_but_not_averaged() {
    let far = scene("far", [-1e308, 1e308, 1.0].map(|x| camera_at([x, 0.0, 0.0])));
    let (report, _) = inspected(&TestSource::new([far]), InspectOptions::default());
    let step = report.baselines.step;
    assert_eq!((step.count, step.non_finite), (0, 2), "the squares overflow: {step:?}");
    assert_eq!((step.min, step.median, step.max), (None, None, None));
    assert_eq!(report.baselines.extent.non_finite, 1);
}

#[test]
fn an_empty_dataset_has_a_report() {
    let (report, _) = inspected(&TestSource::new([]), InspectOptions { per_scene: true, ..InspectOptions::default() });
    assert_eq!((report.scenes, report.frames), (SceneCounts::default(), 0));
    assert_eq!(report.intrinsics.fx, Summary::default());
    insta::assert_snapshot!("nothing", report.to_string());
}

#[test]
fn the_table_matches_the_snapshots() {
    let all = InspectOptions { sizes: SizeSampling::All, per_scene: true };
    insta::assert_snapshot!("troubled", inspected(&dataset_with_problems(), all).0.to_string());
    insta::assert_snapshot!("small", inspected(&small_dataset(), InspectOptions::default()).0.to_string());
}

#[test]
fn json_has_stable_names() {
    let (report, _) = inspected(&small_dataset(), InspectOptions { per_scene: true, ..InspectOptions::default() });
    let json: serde_json::Value = serde_json::to_value(&report).unwrap();
    assert_eq!(json["baselines"]["step"]["max"], 3.0);
    assert_eq!(
        json["per-scene"][1],
        serde_json::json!({
            "key": "lone", "frames": 1, "images": 0, "step": null, "rotation-degrees": null,
            "extent": 0.0, "path-length": 0.0,
        })
    );
    let mut names: Vec<_> = json.as_object().unwrap().keys().cloned().collect();
    names.sort();
    insta::assert_snapshot!("json_names", names.join("\n"));
}

#[test]
fn the_report_does_not_depend_on_the_number_of_threads() {
    let scenes = (0..600).map(|n| wandering_scene(&format!("{n:03}"), 2 + n % 17));
    let source = TestSource::new(scenes).with_unreadable("300");
    let on = |threads| {
        let options = InspectOptions { per_scene: true, ..InspectOptions::default() };
        on_threads(threads, || serde_json::to_string(&inspected(&source, options).0).unwrap())
    };
    assert_eq!(on(1), on(5));
}
