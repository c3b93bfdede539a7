//! `atsplat protocol` as a user runs it.

use std::path::{Path, PathBuf};

use crate::common::{atsplat, printed_json, read_json, succeed, write_trajectory};
use atsplat_pixels::ImageU8;

fn repository() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..")
}

#[test]
fn the_example_index_is_linted() {
    insta::assert_snapshot!(succeed(&repository(), &["protocol", "lint", "eval/indices/example.json"]));
}

#[test]
fn presets_are_listed_and_shown() {
    let here = repository();
    insta::assert_snapshot!(succeed(&here, &["protocol", "list"]));
    let shown = succeed(&here, &["protocol", "show", "re10k-2v-256"]);
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("mine.toml"), &shown).unwrap();
    assert_eq!(succeed(folder.path(), &["protocol", "show", "mine.toml"]), shown, "what is shown is a preset itself");
}

#[test]
fn builds_measures_lints_and_extrapolates_an_index() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    std::fs::create_dir(here.join("data")).unwrap();
    for (key, frames) in [("aaaa", 200), ("bbbb", 150), ("short", 5)] {
        write_trajectory(&here.join("data").join(format!("{key}.txt")), frames);
    }

    let built = succeed(here, &["protocol", "build", "data", "--sampler", "dl3dv-6v", "-o", "index.json"]);
    assert!(built.starts_with("sampling rule dl3dv-6v (farthest-point): 2 scenes, 2 entries"), "{built}");
    let short = "      1  scenes without an entry: too-few-frames, such as short: needs 6 frames, has 5\n";
    assert!(built.contains(short), "{built}");

    let lint = printed_json(here, &["protocol", "lint", "index.json", "--json"]);
    assert_eq!((&lint["keys"], &lint["null"], &lint["scenes"]), (&3.into(), &1.into(), &2.into()), "{lint}");

    atsplat(
        here,
        &["protocol", "overlap", "index.json", "--data", "data", "-o", "overlap.json", "--plot", "overlap.svg"],
    )
    .prints(0, "      2  measured");
    assert!(std::fs::read_to_string(here.join("overlap.svg")).unwrap().starts_with("<svg"));
    let measured = read_json(&here.join("overlap.json"));
    let value = measured["aaaa"]["overlap"].as_f64().unwrap();
    assert!((0.0..=1.0).contains(&value), "{measured}");

    atsplat(here, &["protocol", "extrapolate", "index.json", "--data", "data", "-o", "outside.json"])
        .prints(0, "2  entries with every target");
    let moved = printed_json(here, &["protocol", "lint", "outside.json", "--against", "index.json", "--json"]);
    assert_eq!(moved["outside-window"]["targets"], 40, "ten before and ten after in two scenes: {moved}");
    assert_eq!(moved["against"]["verdict"], "different");
}

#[test]
fn fields_that_a_new_index_does_not_carry_over_are_counted() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    let entry = r#"{"context": [20, 70], "target": [40], "overlap": 0.2, "note": "blurred", "weight": 2}"#;
    std::fs::write(here.join("index.json"), format!(r#"{{"a": {entry}, "b": {entry}}}"#)).unwrap();
    let expected = ["2 × field \"note\"", "2 × field \"weight\"", "2 × unknown-index-field"];
    for command in ["overlap", "extrapolate"] {
        let outcome = atsplat(here, &["protocol", command, "index.json", "-o", "out.json"]);
        let output = format!("{}{}", outcome.stdout, outcome.stderr);
        assert!(outcome.code == 0 && expected.iter().all(|text| output.contains(text)), "{command}: {output}");
        assert!(!std::fs::read_to_string(here.join("out.json")).unwrap().contains("note"), "{command}");
    }
    let read_only = atsplat(here, &["protocol", "overlap", "index.json"]);
    assert!(!read_only.stderr.contains("note"), "nothing is written: {}", read_only.stderr);
}

#[test]
fn an_index_without_overlaps_has_no_histogram() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    let overlap = ["protocol", "overlap", "index.json", "-o", "out.json", "--plot", "plot.svg"];
    let write = |more: &str| {
        let text = format!(r#"{{"a": {{"context": [20, 70], "target": [40]{more}}}, "b": null}}"#);
        std::fs::write(here.join("index.json"), text).unwrap();
    };
    write("");
    atsplat(here, &overlap).says(1, "error: no entry of index.json states an overlap: --data measures it");
    assert!(!here.join("out.json").exists() && !here.join("plot.svg").exists());
    write(r#", "overlap": 0.2"#);
    succeed(here, &overlap);
}

/// NoPoSplat's tagger puts overlaps below its edges into the second bin; that rule belongs to its edges.
#[test]
fn an_overlap_below_ones_own_bins_is_in_none() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    let index = r#"{"a": {"context": [20, 70], "target": [40], "overlap": 0.04}}"#;
    std::fs::write(here.join("index.json"), index).unwrap();
    let bins = |more: &[&str]| {
        let printed = succeed(here, &[&["protocol", "overlap", "index.json", "--json"], more].concat());
        let bins = serde_json::from_str::<serde_json::Value>(&printed).unwrap()["bins"].take();
        [&bins["bins"][1]["count"], &bins["below"]].map(|count| count.as_u64().unwrap())
    };
    assert_eq!(bins(&["--bins", "0.2,a:0.5,b:1"]), [0, 1]);
    assert_eq!((bins(&[]), bins(&["--strict-bins"])), ([1, 0], [0, 1]));
}

/// Overlaps of an index that names no estimator, and measured ones, for which the bins were not published.
#[test]
fn options_about_published_bins_that_change_nothing_are_reported() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    std::fs::create_dir(here.join("data")).unwrap();
    write_trajectory(&here.join("data/a.txt"), 80);
    let index = r#"{"a": {"context": [20, 70], "target": [40], "overlap": 0.2}}"#;
    std::fs::write(here.join("index.json"), index).unwrap();
    let without_effect = |more: &[&str]| {
        let outcome = atsplat(here, &[&["protocol", "overlap", "index.json"], more].concat());
        assert_eq!(outcome.code, 0, "{}", outcome.stderr);
        ["--force", "--strict-bins"].map(|option| outcome.stderr.contains(&format!("{option} has no effect")))
    };
    let both = ["--force", "--strict-bins"];
    assert_eq!((without_effect(&[]), without_effect(&both)), ([false; 2], [true, false]));
    let measured = |more: &[&str]| without_effect(&[&["--data", "data"], more].concat());
    assert_eq!((measured(&[]), measured(&["--strict-bins"])), ([false; 2], [false, true]));
    assert_eq!(measured(&both), [false; 2]);
}

#[test]
fn results_do_not_depend_on_the_thread_count() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    std::fs::create_dir(here.join("data")).unwrap();
    for key in 0..7 {
        write_trajectory(&here.join("data").join(format!("{key:04}.txt")), 100 + 10 * key);
    }
    let build = |threads: &str| {
        let args = ["--threads", threads, "protocol", "build", "data", "--sampler", "re10k-2v", "-o", threads];
        succeed(here, &args);
        std::fs::read(here.join(threads)).unwrap()
    };
    assert_eq!(build("1"), build("3"));
}

#[test]
fn exit_codes_of_usage_errors_broken_files_and_strict_skips() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    assert_eq!(atsplat(here, &["protocol", "lint"]).code, 2);
    std::fs::write(here.join("broken.json"), r#"{"a": {"context": [-1], "target": [0]}}"#).unwrap();
    let broken = atsplat(here, &["protocol", "lint", "broken.json"]);
    assert_eq!(broken.code, 1);
    assert!(broken.stderr.contains("context") && broken.stderr.contains("broken.json"), "{}", broken.stderr);

    std::fs::create_dir(here.join("data")).unwrap();
    write_trajectory(&here.join("data/short.txt"), 3);
    let args = ["protocol", "build", "data", "--sampler", "re10k-2v", "-o", "index.json"];
    atsplat(here, &args).says(1, "no scene of data has an entry");
    write_trajectory(&here.join("data/long.txt"), 200);
    assert_eq!(atsplat(here, &args).code, 0);
    assert_eq!(atsplat(here, &[&args[..], &["--strict"]].concat()).code, 4);
}

/// Frames that the sampler was not given, although every scene has its entry, and images of the index that cannot be read.
#[test]
fn a_strict_build_rejects_missing_and_unreadable_images() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    std::fs::create_dir_all(here.join("data/a")).unwrap();
    write_trajectory(&here.join("data/a.txt"), 200);
    let image = atsplat_pixels::encode_png(&ImageU8::new(64, 36, vec![9; 64 * 36 * 3]).unwrap()).unwrap();
    for frame in 0..200 {
        std::fs::write(here.join(format!("data/a/{}.png", frame * 33_367)), &image).unwrap();
    }
    let build = ["protocol", "build", "data", "--sampler", "re10k-2v", "-o", "index.json", "--strict"];
    succeed(here, &build);
    let index = read_json(&here.join("index.json"));
    let target = index["a"]["target"][1].as_u64().unwrap();
    let empty = here.join(format!("data/a/{}.png", target * 33_367));
    std::fs::write(&empty, []).unwrap();
    let named = format!("frame {target} of scene \"a\"");
    atsplat(here, &build).says(4, &named);
    std::fs::write(&empty, &image).unwrap();
    std::fs::remove_file(here.join("data/a/0.png")).unwrap();
    atsplat(here, &build).prints(4, "1  frames skipped");
    succeed(here, build.split_last().unwrap().1);
    let help = succeed(here, &["protocol", "build", "--help"]);
    // Lines are wrapped at the terminal width.
    let help = help.split_whitespace().collect::<Vec<_>>().join(" ");
    assert!(help.contains("Exit with code 4 if a scene has no entry, or frames lack an image"), "{help}");
}

/// A leak, a repetition or another protocol's index fails under `--strict`; what the protocol has published does not.
#[test]
fn a_strict_lint_rejects_an_unfit_index() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    let entry = r#"{"context": [5, 20], "target": [9, 30]}"#;
    for (name, index, fault) in [
        ("empty", "{}".to_owned(), Some("unfit for an evaluation: no scene has an entry")),
        ("nulls", r#"{"a": null}"#.to_owned(), Some("unfit for an evaluation: no scene has an entry")),
        ("outside", format!(r#"{{"a": {entry}, "b": null}}"#), None),
        ("leak", format!(r#"{{"a": {}}}"#, entry.replace('9', "20")), Some("unfit for an evaluation: 1 target is a")),
        ("twice", format!(r#"{{"a": {}}}"#, entry.replace("30", "9")), Some("1 target repeated in its entry")),
        ("keys", format!(r#"{{"a": {entry}, "a": {entry}}}"#), Some("1 repeated scene key")),
    ] {
        std::fs::write(here.join(name), index).unwrap();
        let strict = atsplat(here, &["protocol", "lint", name, "--strict"]);
        assert_eq!(strict.code, if fault.is_some() { 4 } else { 0 }, "{name}: {}", strict.stderr);
        assert_eq!(strict.stderr.contains("unfit"), fault.is_some(), "{name}: {}", strict.stderr);
        assert!(strict.stderr.contains(fault.unwrap_or_default()), "{name}: {}", strict.stderr);
        succeed(here, &["protocol", "lint", name]);
    }
    let exit = |args: &[&str]| atsplat(here, &[&["protocol", "lint", "--strict"], args].concat()).code;
    assert_eq!(exit(&["outside", "--preset", "dl3dv-6v-256x448"]), 4, "two views instead of six");
    assert_eq!((exit(&["outside", "--against", "outside"]), exit(&["outside", "--against", "twice"])), (0, 4));
    let published = repository().join("eval/indices/rooms-2v.json");
    let published = published.to_str().unwrap();
    assert_eq!((exit(&[published]), exit(&[published, "--preset", "rooms-2v-128"])), (4, 0));
    assert!(succeed(here, &["protocol", "lint", "--help"]).contains("unfit"));
}

#[test]
fn unknown_names_are_usage_errors_before_anything_is_read() {
    for (args, expected) in [
        (&["lint", "nowhere", "--preset", "nope"][..], "re10k-2v-256"),
        (&["show", "nope"], "re10k-2v-256"),
        (&["build", "nowhere", "-o", "out", "--sampler", "nope"], "re10k-2v"),
        (&["overlap", "nowhere", "--data", "nowhere", "--estimator", "nope"], "epipolar-ray"),
        (&["overlap", "nowhere", "--bins", "0.5,a:0.2"], "edges that increase"),
        (&["overlap", "nowhere", "--plot", "x.jpg"], ".svg or .png"),
        (&["overlap", "nowhere", "--bins", "0.05,a:0.8", "--force"], "cannot be used with"),
        (&["overlap", "nowhere", "--bins", "0.05,a:0.8", "--strict-bins"], "cannot be used with"),
        (
            &["overlap", "nowhere", "--data", "nowhere", "--depth", "nowhere"],
            "--depth requires --estimator depth-covisibility (found --estimator epipolar-ray)",
        ),
        (&["extrapolate", "nowhere", "-o", "out", "--margin", "0"], "expected 1 to 1000 frames"),
        (&["extrapolate", "nowhere", "-o", "out", "--margin", "1001"], "expected 1 to 1000 frames"),
        (&["extrapolate", "nowhere", "-o", "out", "--margin", "18446744073709551615"], "expected 1 to 1000 frames"),
    ] {
        atsplat(&repository(), &[&["protocol"], args].concat()).says(2, expected);
    }
}

#[test]
fn an_unwritable_output_fails_before_the_work() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    std::fs::write(here.join("file"), "").unwrap();
    let args = ["protocol", "build", "nowhere", "--sampler", "dl3dv-6v", "-o", "file/index.json"];
    atsplat(here, &args).says(1, "file");

    let index = repository().join("eval/indices/example.json");
    let args = ["protocol", "overlap", index.to_str().unwrap(), "--data", "nowhere", "--plot", "file/plot.svg"];
    atsplat(here, &args).says(1, "file");
}

#[test]
fn compares_overlap_estimators_with_true_covisibility() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    let of_scenes = |scenes| ["protocol", "estimators", "--scenes", scenes, "--pairs", "6", "--size", "48x36"];
    let report = printed_json(here, &[&of_scenes("3")[..], &["--json"]].concat());
    assert_eq!(report["pairs"].as_array().unwrap().len(), 36, "{report}");
    let rows = report["estimators"].as_array().unwrap();
    for kind in ["rooms", "yards"] {
        let of = |name: &str| {
            let row = rows.iter().find(|row| row["kind"] == kind && row["estimator"] == name).unwrap();
            row["rank-correlation"].as_f64().unwrap()
        };
        let ordered = [of("epipolar-ray"), of("depth-covisibility-2x2")];
        assert!(ordered[1] > 0.85 && ordered[1] > ordered[0], "{kind}: depth knows more than cameras do: {ordered:?}");
    }
    let args = of_scenes("1");
    let text = succeed(here, &[&args[..], &["--plot", "estimators.svg"]].concat());
    assert!(text.starts_with("12 pairs of views of 2 simulated scenes"), "{text}");
    let plot = || std::fs::read_to_string(here.join("estimators.svg")).unwrap();
    let first = plot();
    assert!(first.contains("depth-covisibility-2x2") && first.contains("yards: rank correlation"), "{first}");
    succeed(here, &[&args[..], &["--plot", "estimators.svg", "--threads", "1"]].concat());
    assert_eq!(plot(), first, "the same pairs give the same bytes on any number of threads");
    assert_eq!(atsplat(here, &[&args[..], &["--plot", "estimators.pdf"]].concat()).code, 2);
}
