//! `atsplat protocol` on datasets: selection of images and depth maps, and reports of failures.

use std::fmt::Write as _;
use std::path::Path;

use crate::common::{atsplat, printed_json, read_json, succeed, write_trajectory};
use atsplat_pixels::exr::{self, Channel, Channels, Values};
use atsplat_tests::shared_data;

/// The capture has images of 960×540 and 480×270; the protocol needs the small ones.
#[test]
fn every_command_uses_the_requested_images() {
    let Some(shared) = shared_data("each_command_takes_the_images_that_are_asked_for") else { return };
    let data = shared.canonicalize().unwrap().join("dl3dv_like");
    let data = data.to_str().unwrap();
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    succeed(here, &["protocol", "build", data, "--images", "8", "--sampler", "dl3dv-6v", "-o", "index.json"]);

    let lint = ["protocol", "lint", "index.json", "--preset", "dl3dv-6v-256x448", "--data", data, "--json"];
    let usable = |args: &[&str]| printed_json(here, &[&lint[..], args].concat())["dataset"]["usable"].as_u64();
    assert_eq!((usable(&["--images", "8"]), usable(&["--images", "4"])), (Some(1), Some(0)));

    for command in [&["overlap", "index.json"][..], &["extrapolate", "index.json", "-o", "outside.json"]] {
        let args = [&["protocol"], command, &["--data", data, "--images", "8"]].concat();
        atsplat(here, &args).says(0, "images_8/frame_00081.png");
    }
    let without_data = atsplat(here, &["protocol", "overlap", "index.json", "--images", "8"]);
    assert_eq!(without_data.code, 2, "{}", without_data.stderr);
}

/// Two cameras that look at a wall at z = 4 from places 1.6 apart: 40 px · 1.6 / 4 = 16 of 80 columns are lost.
#[test]
fn measures_depth_covisibility_from_files() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    write_scenes(here, &["wall", "bare"]);
    write_depths(here, "wall", 4.0);
    let entry = r#"{"context": [0, 1], "target": [0]}"#;
    let index = format!(r#"{{"wall": {entry}, "bare": {entry}, "gone": {entry}}}"#);
    std::fs::write(here.join("index.json"), index).unwrap();

    let measure = ["protocol", "overlap", "index.json", "--data", "data", "--estimator", "depth-covisibility"];
    atsplat(here, &measure).says(2, "--depth <FOLDER>");
    atsplat(here, &[&measure[..], &["--depth", "nowhere"]].concat()).says(1, "nowhere");

    let args = [&measure[..], &["--depth", "depth", "-o", "overlap.json"]].concat();
    let report = succeed(here, &args);
    for line in [
        "      1  measured",
        "      1  not measured: scene-missing",
        "      1  not measured: unreadable",
        "\"bare\" entry 0: reading a depth map",
    ] {
        assert!(report.contains(line), "{line}: {report}");
    }
    let measured = read_json(&here.join("overlap.json"));
    assert_eq!(measured["wall"]["overlap"].to_string(), "0.8", "{measured}");
    assert_eq!(measured["wall"]["overlap_estimator"], "depth-covisibility-2x2", "{measured}");
    assert_eq!(atsplat(here, &[&args[..], &["--strict"]].concat()).code, 4);
}

/// Renders are numbered, and the frames of the data are named after their times. Depths of other cameras are not theirs.
#[test]
fn renders_of_the_cameras_of_the_data_are_depth_maps() {
    let folder = crate::render_scene::folder();
    let here = folder.path();
    let render = |path: &[&str]| {
        let args = ["render", "scene.ply", "--size", "64x36", "--formats", "exr", "--out", "depth/path"];
        succeed(here, &[&args[..], path].concat());
    };
    std::fs::write(here.join("index.json"), r#"{"path": {"context": [2, 9], "target": [5]}}"#).unwrap();
    let data = ["--data", "path.txt", "--estimator", "depth-covisibility", "--depth", "depth"];
    let measure = || atsplat(here, &[&["protocol", "overlap", "index.json"], &data[..]].concat());
    for channel in ["depth", "median-depth"] {
        render(&["--cameras", "path.txt", "--channels", channel]);
        let measured = measure();
        let one = measured.stdout.contains("      1  measured");
        assert!(measured.code == 0 && one, "{channel}: {}{}", measured.stdout, measured.stderr);
    }
    render(&["--orbit", "12"]);
    measure().says(1, "expected one view of frame \"66734\", found 0");
}

#[test]
fn overlaps_that_cannot_be_measured_are_counted_by_entry_and_scene() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    write_scenes(here, &["wall", "bare", "void"]);
    std::fs::write(here.join("data/torn.txt"), "https://example.org/video\n0 0.5\n").unwrap();
    write_depths(here, "wall", 4.0);
    write_depths(here, "void", 0.0);
    let entry = r#"{"context": [0, 1], "target": [0], "overlap": 0.3}"#;
    let two = format!("[{entry}, {entry}]");
    let index = format!(r#"{{"wall": {entry}, "void": {entry}, "bare": {entry}, "torn": {two}, "gone": {two}}}"#);
    std::fs::write(here.join("index.json"), index).unwrap();
    std::fs::write(here.join("gone.json"), format!(r#"{{"gone": {entry}}}"#)).unwrap();

    let measure = |index: &str, data: &str, more: &[&str]| {
        let estimator = ["--estimator", "depth-covisibility", "--depth", "depth"];
        atsplat(here, &[&["protocol", "overlap", index, "--data", data], &estimator[..], more].concat())
    };
    let measured = measure("index.json", "data", &[]);
    assert_eq!(measured.code, 0, "{}", measured.stderr);
    for line in [
        "      1  measured",
        "      1  of the index replaced",
        "      6  of the index removed",
        "      2  not measured: scene-missing, in 1 scene",
        "      3  not measured: unreadable, in 2 scenes",
        "      1  not measured: overlap-undefined, in 1 scene",
        "\"bare\" entry 0: reading a depth map",
        "\"torn\" entry 0: ",
        "\"void\" entry 0: overlap (depth-covisibility-2x2): a depth map has no pixel of known depth",
    ] {
        assert!(measured.stdout.contains(line), "{line}: {}", measured.stdout);
    }
    assert!(!measured.stdout.contains("\"torn\" entry 1"), "one of each scene: {}", measured.stdout);
    assert!(measured.stderr.contains("torn.txt"), "the scene's file is named: {}", measured.stderr);
    assert_eq!(measure("index.json", "data", &["--strict"]).code, 4);
    measure("index.json", "nowhere", &[]).says(1, "(nowhere)");

    measure("gone.json", "data", &["-o", "out.json", "--plot", "out.svg", "--strict"])
        .says(1, "no overlap of gone.json");
    assert!(!here.join("out.json").exists() && !here.join("out.svg").exists(), "nothing is written");
}

/// Two views of each scene: cameras 1.6 apart that look along z.
fn write_scenes(here: &Path, scenes: &[&str]) {
    std::fs::create_dir_all(here.join("data")).unwrap();
    for scene in scenes {
        let mut text = "https://example.org/video\n".to_owned();
        for (time, x) in [(0, 0.0), (40_000, -1.6)] {
            writeln!(text, "{time} 0.5 0.7 0.5 0.5 0 0 1 0 0 {x} 0 1 0 0 0 0 1 0").unwrap();
        }
        std::fs::write(here.join("data").join(format!("{scene}.txt")), text).unwrap();
    }
}

/// Depth maps of both views of a scene, with one depth everywhere.
fn write_depths(here: &Path, scene: &str, depth: f32) {
    std::fs::create_dir_all(here.join("depth").join(scene)).unwrap();
    for time in ["0", "40000"] {
        let channel = Channel { name: "Z".to_owned(), values: Values::Depth, samples: vec![depth; 80 * 60] };
        let bytes = exr::write(&Channels::new(80, 60, vec![channel]).unwrap()).unwrap();
        std::fs::write(here.join("depth").join(scene).join(format!("{time}.exr")), bytes).unwrap();
    }
}

/// Reported before the index is read.
#[cfg(not(feature = "opencv"))]
#[test]
fn feature_coverage_needs_its_feature() {
    let args = ["protocol", "overlap", "nowhere.json", "--data", "nowhere", "--estimator", "feature-coverage"];
    let folder = tempfile::tempdir().unwrap();
    atsplat(folder.path(), &args).says(1, "--features opencv");
}

#[test]
fn missing_scenes_are_skipped_and_the_split_is_recognised() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    std::fs::create_dir(here.join("data")).unwrap();
    write_trajectory(&here.join("data/here.txt"), 100);
    let entry = r#"{"context": [0, 10, 20, 30, 40, 49], "target": [5]}"#;
    std::fs::write(here.join("one.json"), format!(r#"{{"here": {entry}}}"#)).unwrap();
    std::fs::write(here.join("two.json"), format!(r#"{{"here": {entry}, "gone": {entry}, "null": null}}"#)).unwrap();
    let split = |index: &str, args: &[&str]| {
        let all = [&["protocol", "extrapolate", index, "-o", "outside.json", "--strict"], args].concat();
        let outcome = atsplat(here, &all);
        (outcome.code, outcome.stdout + &outcome.stderr)
    };
    assert_eq!(split("two.json", &[]).0, 0, "without data nothing is missing");
    let (code, said) = split("two.json", &["--data", "data"]);
    assert_eq!(code, 4, "{said}");
    assert!(said.contains("1  entries whose scene length is unknown") && said.contains("scene-not-found"), "{said}");
    let (code, said) = split("one.json", &["--data", "data"]);
    assert_eq!(code, 0, "{said}");
    assert!(said.contains("targets by distance: -10 to -1: 1 each, 1 to 10: 1 each\n"), "{said}");

    let lint = ["protocol", "lint", "outside.json", "--preset", "dl3dv-6v-extrapolation"];
    atsplat(here, &lint).prints(0, "derived by its rule, but not from all scenes");
    let report = printed_json(here, &[&lint[..], &["--json"]].concat());
    assert_eq!(report["targets-by-distance"]["-10"], 1, "{report}");
    assert_eq!(report["preset"]["match"], "derived-from-other");
    atsplat(here, &["protocol", "lint", "one.json", "--preset", "dl3dv-6v-extrapolation"])
        .prints(0, "not one of its indices");
}

#[test]
fn recognises_the_published_split() {
    let Some(shared) = shared_data("the_published_split_is_known_again") else { return };
    let index = shared.join("index/depthsplat/dl3dv_start_0_distance_50_ctx_6v_video_0_50.json");
    let index = index.canonicalize().unwrap();
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    let lint = |index: &str| succeed(here, &["protocol", "lint", index, "--preset", "dl3dv-6v-extrapolation"]);
    assert!(lint(index.to_str().unwrap()).contains("from which `protocol extrapolate` derives its index"));
    succeed(here, &["protocol", "extrapolate", index.to_str().unwrap(), "-o", "outside.json"]);
    let text = lint("outside.json");
    assert!(text.contains("preset dl3dv-6v-extrapolation: its index, derived from depthsplat-dl3dv-6v"), "{text}");
    assert!(text.contains("targets by distance -10 to -1: 140 each, 1 to 10: 140 each"), "{text}");
}
