//! Scenes and images of a dataset that a command does not read: `--strict` counts them, and JSON has them.

use crate::evaluation;
use std::path::Path;

use crate::common::{Outcome, atsplat, json_of, printed_json, succeed, write_trajectory};
use crate::evaluation::{write_index, write_noise, write_preset};
use atsplat_pixels::{ImageU8, encode_png};
use serde_json::{Value, json};

const RULE: &str = "[sampler]\nsampler = 'evenly-spaced'\ncontext-views = 2\ntarget-views = 3\n";

fn image() -> Vec<u8> {
    encode_png(&ImageU8::new(16, 12, vec![128; 16 * 12 * 3]).unwrap()).unwrap()
}

/// A capture of 30 photos.
fn write_capture(folder: &Path) {
    std::fs::create_dir_all(folder.join("images")).unwrap();
    let frame = |at: u32| {
        std::fs::write(folder.join(format!("images/{at}.png")), image()).unwrap();
        let pose =
            [[1.0, 0.0, 0.0, 0.1 * f64::from(at)], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]];
        json!({ "file_path": format!("images/{at}.png"), "transform_matrix": pose })
    };
    let frames: Vec<Value> = (0..30).map(frame).collect();
    let transforms = json!({ "w": 16, "h": 12, "fl_x": 16, "frames": frames });
    std::fs::write(folder.join("transforms.json"), transforms.to_string()).unwrap();
}

fn strict_json(here: &Path, args: &[&str]) -> (i32, Value) {
    let Outcome { code, stdout, stderr, .. } = atsplat(here, &[args, &["--strict", "--json"]].concat());
    let report = serde_json::from_str(&stdout);
    assert!(report.is_ok(), "{args:?}: {stdout}{stderr}");
    (code, report.unwrap())
}

/// Two trajectories next to a capture, which is what the folder is read as.
#[test]
fn strict_counts_scenes_of_another_format() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    write_capture(&here.join("data/capture"));
    std::fs::write(here.join("rule.toml"), RULE).unwrap();
    let check = |name: &str, left_out: u64| {
        let code = if left_out == 0 { 0 } else { 4 };
        let [csv, chunks, index] = ["csv", "chunks", "json"].map(|ending| format!("{name}.{ending}"));
        let build = ["protocol", "build", "data", "--sampler", "rule.toml", "-o", &index];
        for (args, pointer) in [
            (&["data", "inspect", "data"][..], "/scenes/left-out"),
            (&["data", "motion", "data"], "/not-read/0/left-out"),
            (&["data", "export", "data", &csv], "/skipped"),
            (&["data", "export", "data", &chunks, "--chunks"], "/skipped"),
            (&build, "/left-out"),
        ] {
            let (found, report) = strict_json(here, args);
            assert_eq!((found, report.pointer(pointer)), (code, Some(&left_out.into())), "{args:?}: {report}");
        }
    };
    check("alone", 0);
    for key in ["a", "b"] {
        write_trajectory(&here.join(format!("data/{key}.txt")), 30);
    }
    check("mixed", 2);
    for (args, text) in [
        (&["data", "inspect", "data"][..], "1 listed: 1 read; 2 left out\n"),
        (&["data", "motion", "data"], "data: 2 scenes left out\n"),
        (&["data", "export", "data", "again.csv"], "2 scenes skipped\n"),
        (
            &["protocol", "build", "data", "--sampler", "rule.toml", "-o", "again.json"],
            "2  scenes skipped: could not be read",
        ),
    ] {
        atsplat(here, args).prints(0, text);
    }
}

/// As above; trajectories alone have no image to undistort.
#[cfg(feature = "opencv")]
#[test]
fn undistortion_counts_scenes_of_another_format_and_fails_without_images() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    write_capture(&here.join("data/capture"));
    let undistort = ["data", "undistort", "data", "--out", "out"];
    let (code, report) = strict_json(here, &undistort);
    assert_eq!((code, &report), (0, &json!({ "written": 30, "skipped": 0 })));
    for key in ["a", "b"] {
        write_trajectory(&here.join(format!("data/{key}.txt")), 30);
    }
    let (code, report) = strict_json(here, &undistort);
    assert_eq!((code, &report), (4, &json!({ "written": 30, "skipped": 2 })));
    atsplat(here, &undistort).prints(0, "30 images written, 2 scenes or frames skipped\n");
    let error = "error: no image of data/a.txt could be undistorted\n";
    atsplat(here, &["data", "undistort", "data/a.txt", "--out", "none"]).says(1, error);
    assert!(!here.join("none/a").exists(), "no list without frames");
}

/// Images of one scene on a disk that is gone; a dataset of trajectories alone misses none.
#[test]
fn strict_counts_the_images_of_a_lost_folder() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    write_noise(here, 2);
    std::fs::write(here.join("rule.toml"), RULE).unwrap();
    let check = |name: &str, missing: u64| {
        let code = if missing == 0 { 0 } else { 4 };
        let (found, report) = strict_json(here, &["data", "inspect", "data"]);
        assert_eq!((found, &report["images"]["missing"]), (code, &missing.into()), "{name}: {report}");
        let index = format!("{name}.json");
        let (found, report) = strict_json(here, &["protocol", "build", "data", "--sampler", "rule.toml", "-o", &index]);
        assert_eq!((found, &report["missing-images"]), (code, &missing.into()), "{name}: {report}");
    };
    check("whole", 0);
    std::fs::remove_dir_all(here.join("data/scene-01")).unwrap();
    check("lost", u64::from(evaluation::FRAMES));
    #[cfg(unix)]
    {
        std::os::unix::fs::symlink("/nowhere/scene-01", here.join("data/scene-01")).unwrap();
        check("dangling", u64::from(evaluation::FRAMES));
    }
    std::fs::remove_dir_all(here.join("data/scene-00")).unwrap();
    check("bare", 0);
}

#[test]
fn motion_counts_unreadable_scenes_and_fails_without_any() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    for data in ["data", "cut"] {
        std::fs::create_dir(here.join(data)).unwrap();
        write_trajectory(&here.join(data).join("a.txt"), 30);
        let text = std::fs::read_to_string(here.join(data).join("a.txt")).unwrap();
        std::fs::write(here.join(data).join("b.txt"), format!("{text}7 0.5\n")).unwrap();
    }
    let (code, report) = strict_json(here, &["data", "motion", "data"]);
    assert_eq!(code, 4);
    assert_eq!(report["not-read"], json!([{ "group": "data", "unreadable": 1, "left-out": 0 }]));
    assert!(succeed(here, &["data", "motion", "data"]).ends_with("data: 1 scene could not be read\n"));
    std::fs::remove_file(here.join("cut/a.txt")).unwrap();
    let nothing = atsplat(here, &["data", "motion", "cut"]);
    assert_eq!(nothing.code, 1, "{}", nothing.stderr);
    for text in ["error: no scene of cut can be read\n", "expected 19 columns, found 2"] {
        assert!(nothing.stderr.contains(text), "{text}: {}", nothing.stderr);
    }
    // The first dataset's warnings do not get lost with an error of the second.
    atsplat(here, &["data", "motion", "data", "nowhere"]).says(1, "1 × unreadable-scene");
}

/// A scene with an entry, and one that is too short for the rule; then one that is cut off, alone.
#[test]
fn expansion_names_what_a_sampler_leaves_out() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    write_noise(here, 1);
    std::fs::write(here.join("rule.toml"), RULE).unwrap();
    let args = ["expansion", "tiny.toml", "--data", "data", "--sampler", "rule.toml"];
    let (code, whole) = strict_json(here, &args);
    assert_eq!((code, &whole["gaps"]), (0, &json!([])), "{whole}");

    write_trajectory(&here.join("data/short.txt"), 2);
    std::fs::create_dir(here.join("data/short")).unwrap();
    for time in [0, 33_367] {
        std::fs::write(here.join(format!("data/short/{time}.png")), image()).unwrap();
    }
    let strict = atsplat(here, &[&args[..], &["--strict", "--json"]].concat());
    assert_eq!(strict.code, 4, "{}", strict.stderr);
    let report = json_of(&strict.stdout);
    let kind = "scenes without an entry in the sampled index";
    let gap = json!({ "kind": kind, "count": 1, "first": "short, …: 1 too-few-targets" });
    assert_eq!((&report["scenes"], &report["gaps"]), (&1.into(), &json!([gap])));
    let warning = format!("warning: tiny: 1 × {kind}\n    short, …: 1 too-few-targets\n");
    assert!(strict.stderr.contains(&warning), "{}", strict.stderr);
    let text = succeed(here, &args);
    assert!(text.contains(&format!("\n- 1 {kind}: short, …: 1 too-few-targets\n")), "{text}");

    std::fs::remove_file(here.join("data/short.txt")).unwrap();
    std::fs::remove_dir_all(here.join("data/short")).unwrap();
    let path = here.join("data/scene-00.txt");
    let trajectory = std::fs::read_to_string(&path).unwrap();
    std::fs::write(&path, trajectory.trim_end().rsplit_once(' ').unwrap().0).unwrap();
    let nothing = atsplat(here, &args);
    assert_eq!(nothing.code, 1, "{}", nothing.stderr);
    let error = format!("error: tiny: none of its trials can be read: 1 {kind}: scene-00, …: 1 unreadable\n");
    for text in [&error, "1 × unreadable-scene", "expected 19 columns, found 18"] {
        assert!(nothing.stderr.contains(text), "{text}: {}", nothing.stderr);
    }
}

/// The header of half a PNG is whole: the damage is found when the trial is measured.
#[test]
fn expansion_counts_trials_with_damaged_images() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    write_noise(here, 6);
    let cut = |scene: u8| {
        let path = here.join(format!("data/scene-{scene:02}/0.png"));
        let whole = std::fs::read(&path).unwrap();
        std::fs::write(&path, &whole[..whole.len() / 2]).unwrap();
    };
    cut(2);
    let kind = "trials that could not be measured";
    let args = ["expansion", "tiny.toml", "--data", "data"];
    let strict = atsplat(here, &[&args[..], &["--strict", "--json"]].concat());
    assert_eq!(strict.code, 4, "{}", strict.stderr);
    let report = json_of(&strict.stdout);
    assert_eq!((&report["scenes"], &report["trials"]), (&5.into(), &5.into()), "{report}");
    let [gap] = report["gaps"].as_array().unwrap().as_slice() else { panic!("{report}") };
    assert_eq!((&gap["kind"], &gap["count"]), (&kind.into(), &1.into()), "{gap}");
    let first = gap["first"].as_str().unwrap();
    assert!(first.starts_with("scene scene-02, entry 0: ") && first.contains("scene-02/0.png"), "{first}");
    assert!(strict.stderr.contains(&format!("warning: tiny: not measured: {first}\n")), "{}", strict.stderr);
    atsplat(here, &args).prints(0, &format!("\n- 1 {kind}: {first}\n"));

    for scene in [0, 1, 3, 4, 5] {
        cut(scene);
    }
    let error = format!("error: tiny: none of its trials can be read: 6 {kind}: scene scene-00, entry 0: ");
    atsplat(here, &args).says(1, &error);
}

#[test]
fn overlaps_of_an_index_without_entries_are_a_failure() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    std::fs::create_dir(here.join("data")).unwrap();
    write_trajectory(&here.join("data/a.txt"), 30);
    std::fs::write(here.join("nulls.json"), r#"{"a": null}"#).unwrap();
    let gone = r#"{"gone": {"context": [0, 1], "target": [0]}}"#;
    std::fs::write(here.join("gone.json"), gone).unwrap();
    for (index, why) in [
        ("nulls.json", "no scene of the index has an entry\n"),
        ("gone.json", "1 entry failed, the first with scene-missing: scene \"gone\", entry 0: "),
    ] {
        let error = format!("error: no overlap of {index} could be measured: {why}");
        atsplat(here, &["protocol", "overlap", index, "--data", "data", "-o", "out.json"]).says(1, &error);
        assert!(!here.join("out.json").exists(), "{index}");
    }
}

/// The plan is next to the folders of the splits.
#[test]
fn strict_counts_a_simulation_that_has_not_ended() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    succeed(
        here,
        &["data", "simulate", "rooms", "--scenes", "1", "--frames", "2", "--size", "16x16", "--samples", "1"],
    );
    let args = ["data", "inspect", "rooms/test", "--strict"];
    assert_eq!(atsplat(here, &args).code, 0);
    std::fs::write(here.join("rooms/planned.json"), "[]").unwrap();
    atsplat(here, &args).says(4, "has not ended: rooms/planned.json lists all its scenes");
}

/// The listed images are twice as large as the protocol expects; a copy next to them fits.
#[test]
fn images_of_another_size_suggest_a_copy_that_fits() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    let run = |more: &[&str]| {
        let args = ["run", "tiny.toml", "--data", "data", "--method", "nearest-view"];
        atsplat(here, &[&args, more].concat())
    };
    write_preset(here, 16);
    let pose = |x: f64| json!([[1, 0, 0, x], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]);
    let frame =
        |at: u32| json!({ "file_path": format!("images/{at}.png"), "transform_matrix": pose(f64::from(at) * 0.1) });
    let frames: Vec<_> = (0..3).map(frame).collect();
    let transforms = json!({ "w": 64, "h": 48, "fl_x": 64, "frames": frames });
    for (images, width) in [("images", 64), ("images_2", 32), ("images_4", 16)] {
        let images = here.join("data/a").join(images);
        std::fs::create_dir_all(&images).unwrap();
        let height = 3 * width / 4;
        let image = ImageU8::new(width, height, vec![90; (width * height * 3) as usize]).unwrap();
        for at in 0..3 {
            std::fs::write(images.join(format!("{at}.png")), encode_png(&image).unwrap()).unwrap();
        }
    }
    std::fs::write(here.join("data/a/transforms.json"), transforms.to_string()).unwrap();
    write_index(&here.join("data"), &["a"], "[0, 2]", "[1]");
    let preset = std::fs::read_to_string(here.join("tiny.toml")).unwrap();
    let sized = "[preprocessing]\nexpected-size = { width = 32, height = 24 }";
    std::fs::write(here.join("tiny.toml"), preset.replacen("[preprocessing]", sized, 1)).unwrap();
    let rejected = run(&["--out", "store"]);
    let advice =
        "\n--images 2 takes copies of the images of the expected size, and --any-size takes images of any size; ";
    rejected.prints(1, advice);
    let taken = run(&["--out", "store", "--images", "2"]);
    assert!(taken.code == 0 && !taken.stdout.contains("--images"), "{}{}", taken.stdout, taken.stderr);
    // Without the listed folder, no argument is needed: the copy is the one of the expected size, not the largest.
    let rename = |from: &str, to: &str| {
        std::fs::rename(here.join("data/a").join(from), here.join("data/a").join(to)).unwrap();
    };
    rename("images", "elsewhere");
    rename("images_2", "images_8");
    run(&["--out", "found"]).prints(0, "image-elsewhere");
    let lint = ["protocol", "lint", "data/evaluation_index.json", "--preset", "tiny.toml", "--data", "data", "--json"];
    let lint = printed_json(here, &lint);
    assert_eq!(lint["dataset"]["usable"], 1, "the lint checks what is run: {lint}");
    rename("images_8", "images_2");
    rename("elsewhere", "images");
    // One image of the copy has another size, as if it were a copy of a copy: no argument helps.
    let image = ImageU8::new(16, 12, vec![90; 16 * 12 * 3]).unwrap();
    std::fs::write(here.join("data/a/images_2/1.png"), encode_png(&image).unwrap()).unwrap();
    std::fs::remove_dir_all(here.join("data/a/images")).unwrap();
    let mixed = run(&["--out", "mixed", "--images", "2"]);
    mixed.prints(1, "--any-size");
    assert!(!mixed.stdout.contains("--images"), "{}", mixed.stdout);
}
