//! `atsplat data` as a user runs it.

use std::path::Path;

use crate::common::{atsplat, printed_json, succeed, write_trajectory};
use atsplat_numeric::Tolerance;
use atsplat_pixels::{ImageU8, encode_png};
use atsplat_rooms::ClipMotion;
use atsplat_scene::torch::{Chunk, ChunkScene, ChunkWriter};
use atsplat_scene::{SharedBytes, Warnings};
use atsplat_tests::shared_data;

#[test]
fn inspects_and_exports_a_trajectory_folder() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    std::fs::create_dir(here.join("data")).unwrap();
    write_trajectory(&here.join("data/aaaa.txt"), 20);
    write_trajectory(&here.join("data/bbbb.txt"), 30);
    std::fs::write(here.join("data/broken.txt"), "https://example.org\n1 2 3\n").unwrap();

    let report = printed_json(here, &["data", "inspect", "data", "--json"]);
    assert_eq!(report["format"], "re10k", "{report}");
    assert_eq!(atsplat(here, &["data", "inspect", "data", "--strict"]).code, 4, "a broken file is a skipped scene");

    for out in ["cameras.parquet", "cameras.arrow", "cameras.csv"] {
        let text = succeed(here, &["data", "export", "data", out]);
        assert!(text.starts_with("2 scenes, 50 frames, "), "{text}");
        assert!(text.contains("1 scene skipped"), "{text}");
    }
    let csv = std::fs::read_to_string(here.join("cameras.csv")).unwrap();
    assert_eq!(csv.lines().count(), 51, "a header and a line per frame");
}

#[test]
fn data_without_a_readable_scene_are_a_failure() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    std::fs::create_dir(here.join("data")).unwrap();
    write_trajectory(&here.join("data/a.txt"), 3);
    std::fs::create_dir(here.join("cut")).unwrap();
    // A line of numbers that is cut off looks like a trajectory until it is read.
    let text = std::fs::read_to_string(here.join("data/a.txt")).unwrap();
    std::fs::write(here.join("cut/a.txt"), format!("{text}7 0.5\n")).unwrap();
    for (args, message) in [
        (&["data", "export", "cut", "cameras.csv"][..], "no scene of cut could be exported"),
        (&["data", "export", "cut", "chunks", "--chunks"], "no scene of cut could be exported"),
        (&["data", "inspect", "cut"], "no scene of cut can be read"),
    ] {
        atsplat(here, args).says(1, message);
    }
    assert!(!here.join("cameras.csv").exists() && !here.join("chunks/index.json").exists());
    succeed(here, &["data", "export", "data", "cameras.csv", "--strict"]);
    assert_eq!(atsplat(here, &["data", "inspect", "data", "--strict"]).code, 0);
}

#[test]
fn errors_name_unknown_data_and_outputs() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    std::fs::create_dir(here.join("empty")).unwrap();
    atsplat(here, &["data", "inspect", "empty"]).says(1, "empty");
    write_trajectory(&here.join("a.txt"), 3);
    atsplat(here, &["data", "export", "a.txt", "cameras.xlsx"]).says(2, "cameras.xlsx");
}

fn image() -> Vec<u8> {
    encode_png(&ImageU8::new(16, 16, vec![128; 16 * 16 * 3]).unwrap()).unwrap()
}

/// An image that fits the cameras of [`write_trajectory`].
fn wide_image() -> Vec<u8> {
    encode_png(&ImageU8::new(43, 24, vec![128; 43 * 24 * 3]).unwrap()).unwrap()
}

/// A trajectory of `frames` frames with one image each.
fn write_scene(folder: &Path, key: &str, frames: usize) {
    write_trajectory(&folder.join(format!("{key}.txt")), frames);
    std::fs::create_dir(folder.join(key)).unwrap();
    for frame in 0..frames {
        std::fs::write(folder.join(key).join(format!("{}.png", frame * 33_367)), wide_image()).unwrap();
    }
}

#[test]
fn frames_elsewhere_are_found_by_key() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    std::fs::create_dir_all(here.join("frames/test")).unwrap();
    write_scene(&here.join("frames/test"), "a", 2);
    std::fs::rename(here.join("frames/test/a.txt"), here.join("a.txt")).unwrap();
    let report = printed_json(here, &["data", "inspect", "a.txt", "--frames", "frames/test", "--json"]);
    assert_eq!(report["images"]["files"], 2, "{report}");
    atsplat(here, &["data", "inspect", "a.txt", "--frames", "frames"])
        .says(1, "such as a/, found no such folder (frames)");
}

/// A broken image affects only its own scene.
#[test]
fn writes_chunks_without_the_broken_scene() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    std::fs::create_dir(here.join("data")).unwrap();
    for key in ["a", "b", "c"] {
        write_scene(&here.join("data"), key, 3);
    }
    std::fs::write(here.join("data/b/0.png"), b"no image at all").unwrap();
    for out in ["data", "./data/test"] {
        let expected = format!("error: {out}: chunks there would be read instead of the scenes of data");
        atsplat(here, &["data", "export", "data", out, "--chunks"]).says(1, &expected);
    }
    assert!(!here.join("data/000000.torch").exists() && !here.join("data/test").exists());
    let text = succeed(here, &["data", "export", "data", "chunks", "--chunks"]);
    assert!(text.contains("2 scenes in 1 chunk\n") && text.contains("1 scene skipped"), "{text}");
    let chunk = Chunk::open(here.join("chunks/000000.torch"), &mut Warnings::new()).unwrap();
    assert_eq!(chunk.keys(), ["a", "c"]);
    assert_eq!(atsplat(here, &["data", "export", "data", "again", "--chunks", "--strict"]).code, 4);
}

/// A truncated copy keeps its header. The chunk contains the same bytes, so the user must be told.
#[test]
fn images_that_are_cut_short_are_found_without_decoding() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    std::fs::create_dir(here.join("data")).unwrap();
    write_scene(&here.join("data"), "a", 3);
    let strict = |args: &[&str]| atsplat(here, &[args, &["--strict"]].concat());
    assert_eq!(strict(&["data", "inspect", "data"]).code, 0);
    let whole = wide_image();
    std::fs::write(here.join("data/a/33367.png"), &whole[..whole.len() - 5]).unwrap();
    let inspected = strict(&["data", "inspect", "data"]);
    inspected.prints(4, "1 unreadable-image");
    assert!(inspected.stdout.contains("3 headers read, 1 cut short"), "{}", inspected.stdout);
    assert!(inspected.stdout.contains("frame 1: cut short: a PNG of "), "{}", inspected.stdout);
    let exported = strict(&["data", "export", "data", "chunks", "--chunks"]);
    exported.prints(4, "1 scene in 1 chunk\n");
    assert!(
        exported.stderr.contains("unreadable-image") && exported.stderr.contains("33367.png"),
        "{}",
        exported.stderr
    );
    assert_eq!(strict(&["data", "inspect", "chunks"]).code, 4, "from a chunk too");
    assert_eq!(strict(&["data", "export", "data", "cameras.csv"]).code, 0, "a table has no images");

    std::fs::write(here.join("data/a/33367.png"), "").unwrap();
    let empty = strict(&["data", "inspect", "data"]);
    empty.prints(4, "2 in files, 1 empty");
    assert!(empty.stdout.contains("a: frame 1: the file is empty (data/a/33367.png)"), "{}", empty.stdout);
    std::fs::remove_file(here.join("data/a/33367.png")).unwrap();
    assert_eq!(strict(&["data", "inspect", "data"]).code, 4, "a missing image");
    succeed(here, &["data", "inspect", "data"]);
}

/// Missing images do not prevent the use of cameras, and are reported by commands that read images or name them.
#[test]
fn missing_images_do_not_affect_cameras() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    let frame = |name: &str| {
        let pose = [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]];
        serde_json::json!({ "file_path": format!("images/{name}.png"), "transform_matrix": pose })
    };
    let frames = [frame("a"), frame("b")];
    let transforms = serde_json::json!({ "w": 16, "h": 12, "fl_x": 16, "k1": 0.1, "frames": frames });
    std::fs::create_dir(here.join("scene")).unwrap();
    std::fs::write(here.join("scene/transforms.json"), transforms.to_string()).unwrap();
    let said = |args: &[&str]| {
        let outcome = atsplat(here, args);
        assert_eq!(outcome.code, 0, "{args:?}: {}", outcome.stderr);
        (outcome.stdout.contains("missing-image"), outcome.stdout.contains("lens-distortion"), outcome.stderr)
    };
    assert!(matches!(said(&["data", "inspect", "scene"]), (true, true, _)));
    let scene = Path::new(env!("CARGO_MANIFEST_DIR")).join("../splat/tests/fixtures/files/degree3_little_endian.ply");
    let render = ["render", scene.to_str().unwrap(), "--cameras", "scene", "--out", "out"];
    let export = ["data", "export", "scene", "cameras.csv"];
    for (args, names_images) in [(&export[..], true), (&["data", "motion", "scene"], false), (&render, false)] {
        let (_, _, stderr) = said(args);
        assert_eq!(stderr.contains("2 × missing-image"), names_images, "{args:?}: {stderr}");
        assert!(stderr.contains("lens-distortion"), "warnings about cameras stay: {args:?}: {stderr}");
    }
}

/// A clone without Git LFS contains pointers instead of large files.
#[test]
fn errors_name_git_lfs_pointers_of_any_format() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    let pointer = "version https://git-lfs.github.com/spec/v1\noid sha256:4d7a\nsize 12345\n";
    let cases: [(&str, &[&str]); 5] = [
        ("transforms.json", &["data", "inspect"]),
        ("000000.torch", &["data", "inspect"]),
        ("clip.txt", &["data", "inspect"]),
        ("nano.safetensors", &["weights", "inspect"]),
        ("scene.ply", &["render", "--orbit", "1", "--out", "out"]),
    ];
    for (name, args) in cases {
        std::fs::write(here.join(name), pointer).unwrap();
        let outcome = atsplat(here, &[args, &[name]].concat());
        let message = outcome.stderr.contains("git lfs pull") && outcome.stderr.contains(name);
        assert!(outcome.code == 1 && message, "{name}: {}", outcome.stderr);
    }
}

fn hostile_chunk(folder: &Path) {
    let mut writer = ChunkWriter::create(folder, u64::MAX).unwrap();
    let camera = [0.5, 0.5, 0.5, 0.5, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0];
    for key in ["../../escaped", "/tmp/escaped", "plain"] {
        let scene = ChunkScene {
            key: key.to_owned(),
            url: String::new(),
            timestamps: vec![7],
            cameras: vec![camera],
            images: vec![SharedBytes::new(image())],
        };
        writer.push(scene).unwrap();
    }
    writer.finish().unwrap();
}

/// Before the dataset is opened: inspecting it may take hours.
#[cfg(not(feature = "opencv"))]
#[test]
fn geometry_is_not_checked_without_opencv() {
    let folder = tempfile::tempdir().unwrap();
    let expected = "--check-geometry requires a build with `--features opencv`";
    atsplat(folder.path(), &["data", "inspect", "nowhere", "--check-geometry"]).says(1, expected);
    let none = atsplat(folder.path(), &["data", "inspect", "nowhere", "--check-geometry", "--check-scenes", "0"]);
    assert_eq!(none.code, 2, "{}", none.stderr);
}

#[test]
fn chunk_keys_cannot_escape_the_output_folder() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    hostile_chunk(&here.join("chunks"));
    let outcome = atsplat(here, &["data", "undistort", "chunks", "-o", "deep/out", "--strict"]);
    if cfg!(feature = "opencv") {
        assert_eq!(outcome.code, 4, "{}", outcome.stderr);
        let entries = std::fs::read_dir(here.join("deep/out")).unwrap().map(|entry| entry.unwrap());
        // Next to the file of the lock.
        let folders = entries.filter(|entry| entry.path().is_dir());
        assert_eq!(folders.map(|entry| entry.file_name()).collect::<Vec<_>>(), ["plain"]);
    } else {
        assert!(outcome.stderr.contains("opencv"), "{}", outcome.stderr);
    }
    assert!(!here.join("escaped").exists() && !here.join("deep/escaped").exists());
}

#[cfg(feature = "opencv")]
#[test]
fn as_many_scenes_are_checked_as_asked_for() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    std::fs::create_dir(here.join("data")).unwrap();
    for key in ["a", "b", "c", "d", "e"] {
        write_trajectory(&here.join(format!("data/{key}.txt")), 3);
    }
    let inspect = ["data", "inspect", "data", "--json", "--check-geometry", "--check-scenes"];
    for (scenes, expected) in [("4", &["a", "b", "c", "d"][..]), ("2", &["a", "c"]), ("9", &["a", "b", "c", "d", "e"])]
    {
        let report = printed_json(here, &[&inspect[..], &[scenes]].concat());
        let checked: Vec<_> =
            report["geometry"].as_array().unwrap().iter().map(|check| check["scene"].as_str().unwrap()).collect();
        assert_eq!(checked, expected);
    }
}

/// A video of 25 frames a second. Several may be cut into one folder at once, but not one scene.
#[cfg(feature = "opencv")]
#[test]
fn images_that_frames_replace_are_counted_and_their_folder_is_locked() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    write_trajectory(&here.join("clip.txt"), 2);
    let video = concat!(env!("CARGO_MANIFEST_DIR"), "/../opencv/tests/fixtures/video/constant.mp4");
    let frames = ["data", "frames", video, "clip.txt", "--out", "out"];
    let removed = "2 earlier images of their timestamps in the other format removed\n";
    assert!(!succeed(here, &frames).contains("removed"));
    assert!(succeed(here, &[&frames[..], &["--png"]].concat()).contains(removed));
    assert!(here.join("out/clip/33367.png").is_file() && !here.join("out/clip/33367.jpg").exists());
    let _lock = atsplat_files::FolderLock::of(&here.join("out/clip")).unwrap();
    atsplat(here, &frames).says(1, "out/clip is being written by process ");
    succeed(here, &[&frames[..], &["--key", "other"]].concat());
}

#[cfg(feature = "opencv")]
#[test]
fn frames_with_the_same_name_are_all_written() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    let frame = |side: &str| {
        std::fs::create_dir_all(here.join("scene/images").join(side)).unwrap();
        std::fs::write(here.join(format!("scene/images/{side}/0001.png")), image()).unwrap();
        serde_json::json!({
            "file_path": format!("images/{side}/0001.png"),
            "transform_matrix": [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]],
        })
    };
    let frames = [frame("left"), frame("right")];
    let transforms = serde_json::json!({ "w": 16, "h": 16, "fl_x": 16, "k1": 0.01, "frames": frames });
    std::fs::write(here.join("scene/transforms.json"), transforms.to_string()).unwrap();
    succeed(here, &["data", "undistort", "scene", "-o", "out"]);
    assert_eq!(std::fs::read_dir(here.join("out/scene/images")).unwrap().count(), 2);
    let report = printed_json(here, &["data", "inspect", "out", "--json"]);
    assert_eq!(report["frames"], 2, "{report}");
}

/// OpenCV's points of the left border end right of those of the right one: the new focal length would be negative.
#[cfg(feature = "opencv")]
#[test]
fn a_lens_without_a_new_camera_matrix_skips_its_scene_alone() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    for (key, k1, p1) in [("a-bent", 0.0, 1.5), ("b-plain", 0.01, 0.0)] {
        std::fs::create_dir_all(here.join("data").join(key).join("images")).unwrap();
        std::fs::write(here.join(format!("data/{key}/images/0.png")), image()).unwrap();
        let pose = [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]];
        let frames = [serde_json::json!({ "file_path": "images/0.png", "transform_matrix": pose })];
        let transforms = serde_json::json!({ "w": 16, "h": 16, "fl_x": 8, "k1": k1, "p1": p1, "frames": frames });
        std::fs::write(here.join(format!("data/{key}/transforms.json")), transforms.to_string()).unwrap();
    }
    let args = ["data", "undistort", "data", "-o", "out", "--mode", "long-lrm"];
    let outcome = atsplat(here, &args);
    assert_eq!(outcome.code, 0, "{}", outcome.stderr);
    assert!(outcome.stdout.contains("1 image written, 1 scene or frame skipped"), "{}", outcome.stdout);
    assert!(outcome.stderr.contains("a-bent: it cannot be undistorted: lens: "), "{}", outcome.stderr);
    assert!(here.join("out/b-plain/transforms.json").is_file() && !here.join("out/a-bent").exists());
    assert_eq!(atsplat(here, &[&args[..], &["--strict"]].concat()).code, 4);
}

#[test]
fn errors_do_not_repeat_their_causes() {
    let folder = tempfile::tempdir().unwrap();
    let outcome = atsplat(folder.path(), &["data", "inspect", "nowhere"]);
    assert_eq!(outcome.stderr.matches("No such file").count(), 1, "{}", outcome.stderr);
    assert_eq!(atsplat(folder.path(), &["--threads", "5000", "protocol", "list"]).code, 2);
}

#[test]
fn measures_the_motion_of_known_and_simulated_cameras() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    std::fs::create_dir(here.join("data")).unwrap();
    write_trajectory(&here.join("data/long.txt"), 200);
    write_trajectory(&here.join("data/short.txt"), 3);
    let args = ["data", "motion", "data", "--simulated", "3", "--plot", "motion.svg"];
    let report = printed_json(here, &[&args[..], &["--json"]].concat());
    let [simulated, real] = report["groups"].as_array().unwrap().as_slice() else { panic!("{report}") };
    assert_eq!(simulated["clips"][2]["clip"], "rooms-train-00000002", "{simulated}");
    assert_eq!((&real["clips"][0]["frames"], &real["too-short"]), (&200.into(), &1.into()), "{real}");
    let plot = || std::fs::read_to_string(here.join("motion.svg")).unwrap();
    let first = plot();
    assert!(first.contains("simulated rooms: median") && first.contains("turn rate"), "{first}");
    atsplat(here, &[&args[..], &["--threads", "1"]].concat()).prints(0, "baseline, 135 frames");
    assert_eq!(plot(), first, "the same clips give the same bytes on any number of threads");
    assert_eq!(atsplat(here, &["data", "motion", "data", "--strict"]).code, 4, "a clip was left out");
    assert!(succeed(here, &["data", "motion"]).contains("RE10K"), "the embedded clips");
    for unread in [["--kind", "yards"], ["--split", "test"]] {
        atsplat(here, &[&["data", "motion", "data"][..], &unread].concat()).says(2, "--simulated <N>");
    }
}

/// Photos of a capture next to a video: nothing is known of how fast the former were taken.
#[test]
fn clips_without_times_have_no_speed() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    std::fs::create_dir(here.join("video")).unwrap();
    write_trajectory(&here.join("video/a.txt"), 60);
    let pose = |at: u32| {
        [[1.0, 0.0, 0.0, 0.1 * f64::from(at)], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]]
    };
    let frame = |at: u32| serde_json::json!({ "file_path": format!("images/{at}.png"), "transform_matrix": pose(at) });
    let frames: Vec<_> = (0..60).map(frame).collect();
    std::fs::create_dir(here.join("photos")).unwrap();
    let transforms = serde_json::json!({ "w": 16, "h": 12, "fl_x": 16, "frames": frames });
    std::fs::write(here.join("photos/transforms.json"), transforms.to_string()).unwrap();
    let outcome = atsplat(here, &["data", "motion", "video", "photos"]);
    assert_eq!(outcome.code, 0, "{}", outcome.stderr);
    for measure in ["speed, units/s", "turn rate, °/s"] {
        let row = |group: &str| {
            let mut lines = outcome.stdout.lines().filter(|line| line.starts_with(measure));
            lines
                .find_map(|line| line.split_once(group))
                .unwrap()
                .1
                .split_whitespace()
                .map(str::to_owned)
                .collect::<Vec<_>>()
        };
        assert_eq!(row("photos"), ["0", "-", "-", "-", "-", "-"], "{measure}: {}", outcome.stdout);
        assert!(row("video")[0] == "1" && row("video")[3] != "-", "{measure}: {}", outcome.stdout);
    }
    let note = "note: photos: 1 clip without timestamps: speeds and turn rates are not known";
    assert!(outcome.stderr.contains(note), "{}", outcome.stderr);
    assert!(outcome.stdout.contains("straightness          photos     1    1.000"), "{}", outcome.stdout);
    let report = printed_json(here, &["data", "motion", "photos", "video", "--json"]);
    let of_group = |group: usize, field: &str| &report["groups"][group]["clips"][0][field];
    for field in ["seconds", "speed"] {
        assert!(of_group(0, field).is_null() && of_group(1, field).is_number(), "{field}: {report}");
    }
}

/// The loader makes rotations orthonormal, which changes their trace by about 1e-9; for half a degree, a step of half a
/// second, the cosine turns that into 1e-3 degrees per second.
const TURNS: Tolerance = Tolerance::absolute(2e-3);

/// `data/measure_motion.py` printed speeds, lengths and ratios with four decimals, seconds with three, angles with two.
#[test]
fn motion_of_real_clips_agrees_with_numpy() {
    let Some(shared) = shared_data("motion_of_real_clips_is_what_numpy_measured") else { return };
    let shared = shared.canonicalize().unwrap();
    let folders = [shared.join("trajectories/cameractrl_16f"), shared.join("re10k/000c3ab189999a83")];
    let here = tempfile::tempdir().unwrap();
    let [short, whole] = folders.each_ref().map(|folder| folder.to_str().unwrap());
    let report = printed_json(here.path(), &["data", "motion", short, whole, "--json"]);
    let groups = report["groups"].as_array().unwrap();
    let clips = groups.iter().flat_map(|group| group["clips"].as_array().unwrap());
    let mut found: Vec<ClipMotion> = clips.map(|clip| serde_json::from_value(clip.clone()).unwrap()).collect();
    found.sort_by(|a, b| a.clip.cmp(&b.clip));
    let expected = ClipMotion::real().unwrap();
    let names = |clips: &[ClipMotion]| clips.iter().map(|clip| (clip.clip.clone(), clip.frames)).collect::<Vec<_>>();
    assert_eq!(names(&found), names(&expected));
    let printed = |decimals: i32| Tolerance::absolute(0.6 * 10f64.powi(-decimals));
    for (found, expected) in found.iter().zip(&expected) {
        let check = |tolerance: Tolerance, read: &dyn Fn(&ClipMotion) -> Vec<f64>| {
            tolerance.assert(read(found), read(expected), &found.clip);
        };
        check(printed(6), &|clip| vec![clip.fx, clip.fy]);
        check(printed(3), &|clip| Vec::from_iter(clip.seconds));
        check(TURNS, &|clip| Vec::from_iter(clip.turn_degrees_per_second));
        check(printed(2), &|clip| Vec::from_iter(clip.travel_to_axis_degrees));
        check(printed(4), &|clip| {
            let lengths = [clip.speed, clip.straightness, clip.baseline_45, clip.baseline_90, clip.baseline_135];
            lengths.into_iter().flatten().collect()
        });
    }
}
