//! Reports of mismatches: indices under presets, overlap estimators, folders of renders, empty runs.

use crate::common;
use std::path::Path;

use crate::common::{atsplat, succeed, write_trajectory};
use crate::evaluation::{write_index, write_preset};
use atsplat_files::Sha256Digest;
use atsplat_pixels::{Image, ImageU8, encode_png, exr};
use atsplat_protocol::IndexFile;
use atsplat_results::Results;

const SIDE: u32 = 40;
const RUN: [&str; 6] = ["run", "tiny.toml", "--data", "data", "--method", "nearest-view"];

/// A grey image that differs between frames.
fn image(frame: usize, side: u32) -> Vec<u8> {
    let shade = u8::try_from(60 + frame).unwrap();
    encode_png(&ImageU8::new(side, side, vec![shade; (side * side * 3) as usize]).unwrap()).unwrap()
}

/// RE10K scenes with an image per frame, next to the protocol `tiny.toml`.
fn dataset(here: &Path, scenes: &[&str], frames: usize) {
    write_preset(here, SIDE);
    for scene in scenes {
        std::fs::create_dir_all(here.join("data").join(scene)).unwrap();
        let path = here.join(format!("data/{scene}.txt"));
        write_trajectory(&path, frames);
        // Square images with square pixels.
        let text = std::fs::read_to_string(&path).unwrap();
        std::fs::write(&path, text.replace(" 0.48 0.86 ", " 0.86 0.86 ")).unwrap();
        for frame in 0..frames {
            std::fs::write(here.join(format!("data/{scene}/{}.png", frame * 33_367)), image(frame, SIDE)).unwrap();
        }
    }
}

fn run(here: &Path, more: &[&str]) -> common::Outcome {
    atsplat(here, &[&RUN, more].concat())
}

#[test]
fn build_and_run_choose_the_same_frames() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    dataset(here, &["scene"], 9);
    for gone in [0, 3, 8] {
        std::fs::remove_file(here.join(format!("data/scene/{}.png", gone * 33_367))).unwrap();
    }
    let rule = "[sampler]\nsampler = 'evenly-spaced'\ncontext-views = 2\ntarget-views = 3\n";
    std::fs::write(here.join("rule.toml"), rule).unwrap();
    atsplat(here, &["protocol", "build", "data", "--sampler", "rule.toml", "-o", "built.json"])
        .prints(0, "3  frames skipped: no image or no usable pose");
    let entry = &IndexFile::read(&here.join("built.json")).unwrap().index.scenes["scene"][0];
    let named: Vec<usize> = entry.context.iter().chain(&entry.target).copied().collect();
    assert!(named.iter().all(|frame| ![0, 3, 8].contains(frame)), "{named:?}");
    let outcome = run(here, &["--sampler", "rule.toml", "--out", "store"]);
    assert_eq!(outcome.code, 0, "{}", outcome.stderr);
    // The sampler and the trials read the same frames: the report alone warns of them.
    let (text, error) = (&outcome.stdout, &outcome.stderr);
    assert!(text.contains("warning: tiny: 3 missing-image: ") && !error.contains("missing-image"), "{text}{error}");
    let results = Results::read(&here.join("store")).unwrap();
    let bytes = std::fs::read(here.join("built.json")).unwrap();
    assert_eq!(results.provenance.presets[0].index_sha256, Sha256Digest::of(&bytes).to_string());
}

#[test]
fn counts_warnings_about_an_index_that_does_not_fit_its_preset() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    dataset(here, &["a", "b"], 9);
    let index = r#"{"a": {"context": [0, 4, 8], "target": [2, 2]}, "b": [{"context": [0, 8], "target": []}, {"context": [1, 1], "target": [3]}]}"#;
    std::fs::write(here.join("index.json"), index).unwrap();
    let outcome = run(here, &["--index", "index.json", "--out", "store"]);
    assert_eq!(outcome.code, 0, "{}", outcome.stderr);
    let warnings = Results::read(&here.join("store")).unwrap().provenance.warnings;
    let lint = succeed(here, &["protocol", "lint", "index.json", "--preset", "tiny.toml"]);
    for text in [
        "1 entries without the preset's 2 context views: scene a, entry 0, field context: expected 2 frames, found 3",
        "1 entries without targets: scene b, entry 0, field target",
        "1 entries with a target twice: scene a, entry 0, field target: expected every frame once, found frame 2 again",
        "1 entries with a context frame twice: scene b, entry 1, field context",
    ] {
        assert!(outcome.stdout.contains(&format!("warning: tiny: {text}")), "{text}: {}", outcome.stdout);
        assert!(lint.contains(text), "{text}: {lint}");
        let kept = |kind: &str, count: u64| text.starts_with(&format!("{count} {kind}: "));
        assert!(
            warnings.iter().any(|warning| warning.preset == "tiny" && kept(&warning.kind, warning.count)),
            "{text}"
        );
    }
}

/// The mean lacks their scene.
#[test]
fn entries_without_targets_are_skipped() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    dataset(here, &["a", "b"], 9);
    let index = r#"{"a": {"context": [0, 8], "target": [3]}, "b": {"context": [0, 8], "target": []}}"#;
    std::fs::write(here.join("index.json"), index).unwrap();
    let outcome = run(here, &["--index", "index.json", "--out", "store", "--strict"]);
    assert_eq!(outcome.code, 4, "{}", outcome.stderr);
    let skipped = Results::read(&here.join("store")).unwrap().provenance.skipped;
    let found: Vec<_> = skipped.iter().map(|entry| (entry.scene.as_str(), entry.reason.as_str())).collect();
    assert_eq!(found, [("b", "no-targets")]);
    let text = &outcome.stdout;
    assert!(text.contains("1 result computed") && text.contains("1 index entry skipped"), "{text}");
}

#[test]
fn replaced_overlaps_name_their_estimator_and_get_their_own_bins() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    dataset(here, &["a"], 60);
    let entry = r#"{"a": {"context": [0, 50], "target": [20], "overlap": 0.2166}}"#;
    std::fs::write(here.join("index.json"), entry).unwrap();
    assert!(succeed(here, &["protocol", "overlap", "index.json"]).contains("1  small"), "as the index ships it");
    let measure = ["protocol", "overlap", "index.json", "--data", "data", "-o", "measured.json"];
    let message = succeed(here, &measure);
    for text in [
        "1  of the index replaced",
        "bins with a third of the overlaps each, as measured by epipolar-ray",
        "were published for overlaps by roma; --force uses them nevertheless",
    ] {
        assert!(message.contains(text) && !message.contains("  small"), "{text}: {message}");
    }
    let forced = succeed(here, &[&measure[..], &["--force"]].concat());
    assert!(
        forced.contains("  small, 0.05") && forced.contains("these overlaps were measured by epipolar-ray"),
        "{forced}"
    );
    let index = IndexFile::read(&here.join("measured.json")).unwrap().index;
    let overlap = index.scenes["a"][0].overlap.clone().unwrap();
    assert_eq!(overlap.estimator.as_deref(), Some("epipolar-ray"));
    let again = succeed(here, &["protocol", "overlap", "measured.json"]);
    assert!(again.contains("as the index records them, by epipolar-ray") && !again.contains("  small"), "{again}");

    // A table of published bins accepts only their estimator.
    let preset = atsplat_protocol::Preset::text_of("re10k-overlap").unwrap();
    let stand_in = "name = \"overlap-40\"\nstands-for = \"re10k-overlap\"";
    let preset = preset.replacen("name = \"re10k-overlap\"", stand_in, 1);
    let preset = preset.replacen("expected-size = { width = 640, height = 360 }\n", "", 1);
    std::fs::write(here.join("overlap.toml"), preset.replacen("256, width = 256", "40, width = 40", 1)).unwrap();
    let args = ["run", "overlap.toml", "--data", "data", "--method", "nearest-view"];
    // Nobody knows what the first index's overlaps are; those of the second are in no bin.
    let unknown = "1 entries whose overlap does not say how it was measured, under bins of one estimator: scene a";
    let other = "1 entries whose overlap was measured otherwise than the bins require, which stay empty";
    for (index, store, code, warning) in
        [("index.json", "shipped", 4, unknown), ("measured.json", "estimated", 0, other)]
    {
        let outcome = atsplat(here, &[&args[..], &["--index", index, "--out", store, "--strict"]].concat());
        assert_eq!(outcome.code, code, "{}", outcome.stderr);
        assert!(outcome.stdout.contains(&format!("warning: overlap-40: {warning}")), "{}", outcome.stdout);
    }
    let report = |store: &str, more: &[&str]| {
        let message = succeed(
            here,
            &[&["report", store, "--tables", "re10k_overlap", "--format", "terminal", "--check-plots"], more].concat(),
        );
        // Lines are wrapped at the terminal width.
        message.split_whitespace().collect::<Vec<_>>().join(" ")
    };
    let shipped = report("shipped", &[]);
    assert!(shipped.contains(unknown) && !shipped.contains("published for roma"), "{shipped}");
    let plot = here.join("reports/latest/plots/re10k_overlap.svg");
    let other = here.join("reports/latest/plots/other.svg");
    std::fs::write(&other, "of the user").unwrap();
    assert!(plot.exists());
    let estimated = report("estimated", &[]);
    assert!(!plot.exists(), "a plot of published numbers alone, and of the report before");
    assert!(other.exists());
    assert!(estimated.contains("measured by epipolar-ray") && estimated.contains("n/c"), "{estimated}");
    let forced = report("estimated", &["--force"]);
    assert!(forced.contains("because of --force") && !forced.contains("n/c PSNR"), "{forced}");
    for (store, has_effect) in [("estimated", true), ("shipped", false)] {
        let outcome = atsplat(here, &["report", store, "--tables", "re10k_overlap", "--force"]);
        assert_eq!(outcome.stderr.contains("note: --force has no effect"), !has_effect, "{}", outcome.stderr);
    }
}

/// An ellipsis in the protocol's title looks like a text that is cut off.
#[test]
fn a_fault_of_a_checked_plot_fails_the_command_when_everything_is_written() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    dataset(here, &["a"], 9);
    // Targets outside the window give a plot over their distance from it.
    write_index(&here.join("data"), &["a"], "[2, 6]", "[0, 4, 8]");
    let preset = std::fs::read_to_string(here.join("tiny.toml")).unwrap();
    let title = preset.lines().find(|line| line.starts_with("title = ")).unwrap();
    std::fs::write(here.join("tiny.toml"), preset.replacen(title, "title = \"two views…\"", 1)).unwrap();
    assert_eq!(run(here, &["--out", "store"]).code, 0);
    let report = |out: &str, more: &[&str]| atsplat(here, &[&["report", "store", "--out", out], more].concat());
    let unchecked = report("unchecked", &[]);
    assert!(unchecked.code == 0 && !unchecked.stderr.contains("plots checked"), "{}", unchecked.stderr);
    for (out, more) in [("checked", &["--check-plots"][..]), ("strict", &["--check-plots", "--strict"])] {
        let checked = report(out, more);
        assert_eq!(checked.code, 1, "{}", checked.stderr);
        for text in ["warning: plot store-tiny-extrapolation: truncated: “two views…", "error: --check-plots: "] {
            assert!(checked.stderr.contains(text), "{text}: {}", checked.stderr);
        }
        assert!(here.join(out).join("index.html").exists());
    }
}

#[test]
fn evaluating_nothing_fails_with_any_flags() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    dataset(here, &["a", "b"], 5);
    std::fs::write(here.join("empty.json"), "{}").unwrap();
    std::fs::write(here.join("elsewhere.json"), r#"{"c": {"context": [0, 4], "target": [2]}}"#).unwrap();
    write_index(&here.join("data"), &["a", "b"], "[0, 4]", "[2]");
    let failures = [
        (&["--index", "empty.json"][..], "the index has no entry"),
        (&["--index", "elsewhere.json"], "none of the index's scenes is in data: c"),
    ];
    for (at, (args, why)) in failures.into_iter().enumerate() {
        for strict in [&["--strict"][..], &[]] {
            let store = format!("store-{at}-{}", strict.len());
            let outcome = run(here, &[args, strict, &["--out", &store]].concat());
            assert_eq!(outcome.code, 1, "{args:?}: {}", outcome.stderr);
            assert!(
                outcome.stderr.contains("nothing was evaluated: ") && outcome.stderr.contains(why),
                "{}",
                outcome.stderr
            );
        }
    }
    for (scene, frame) in ["a", "b"].into_iter().flat_map(|scene| (0..5).map(move |frame| (scene, frame))) {
        std::fs::write(here.join(format!("data/{scene}/{}.png", frame * 33_367)), "no image").unwrap();
    }
    run(here, &["--out", "broken"]).says(1, "every entry was skipped: 2 image-unreadable");
}

/// A NaN in each render leaves no score, and one finite render leaves one.
#[test]
fn renders_without_a_score_fail_the_command() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    dataset(here, &["a"], 5);
    write_index(&here.join("data"), &["a"], "[0, 4]", "[1, 2]");
    std::fs::create_dir_all(here.join("renders/a")).unwrap();
    let write = |frame: usize, first: f32| {
        let mut samples = vec![0.25; (SIDE * SIDE * 3) as usize];
        samples[0] = first;
        let render = exr::write_rgb(&Image::new(SIDE, SIDE, samples).unwrap(), &exr::Values::DisplayReferred).unwrap();
        std::fs::write(here.join(format!("renders/a/{frame:06}.exr")), render).unwrap();
    };
    write(1, f32::NAN);
    write(2, f32::NAN);
    let score =
        |store| atsplat(here, &["score", "tiny.toml", "--data", "data", "--renders", "renders", "--out", store]);
    let none = score("none");
    assert_eq!(none.code, 1, "{}", none.stderr);
    let why = "nothing was evaluated: all of 2 targets have non-finite samples, the first with: 1 in the render";
    assert!(none.stderr.contains(why), "{}", none.stderr);
    write(2, 0.25);
    score("one").prints(0, "1 with non-finite samples");
    let expected = "one: tiny: 1 target of renders has NaN or infinite samples: scene a, frame 1: 1 in the render";
    atsplat(here, &["report", "one", "--strict", "--out", "page"]).says(4, expected);
}

/// Entries without a trial leave no row: the record of the run tells of them.
#[test]
fn a_strict_report_finds_entries_that_were_not_run() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    dataset(here, &["a"], 5);
    let there = r#"{"context": [0, 3], "target": [1]}"#;
    let elsewhere = r#"{"context": [0, 4], "target": [2]}"#;
    let report = |store, format| atsplat(here, &["report", store, "--strict", "--out", "page", "--format", format]);
    std::fs::write(here.join("whole.json"), format!("{{\"a\": {there}}}")).unwrap();
    assert_eq!(run(here, &["--index", "whole.json", "--out", "whole"]).code, 0);
    let whole = report("whole", "csv");
    assert!(whole.code == 0 && !whole.stderr.contains("warning"), "{}", whole.stderr);

    let frame = 4 * 33_367;
    std::fs::remove_file(here.join(format!("data/a/{frame}.png"))).unwrap();
    let index = format!("{{\"a\": [{elsewhere}, {there}], \"gone\": {elsewhere}}}");
    std::fs::write(here.join("index.json"), index).unwrap();
    assert_eq!(run(here, &["--index", "index.json", "--out", "part"]).code, 0);
    let part = report("part", "markdown");
    assert_eq!(part.code, 4, "{}", part.stderr);
    for expected in [
        "warning: part: tiny: 1 scene of the index is not in the data: gone\n",
        "warning: part: tiny: 1 index entry was skipped: scene a, entry 0: image-missing: frame 4 (",
    ] {
        assert!(part.stderr.contains(expected), "{expected}: {}", part.stderr);
    }
    assert!(part.stderr.contains("1 file of an earlier report removed from page\n"), "{}", part.stderr);
    assert!(!here.join("page/tables/protocol-tiny.csv").exists(), "the table of the report before");
}

#[test]
fn images_of_another_size_suggest_any_size() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    dataset(here, &["a"], 5);
    write_index(&here.join("data"), &["a"], "[0, 4]", "[2]");
    let preset = std::fs::read_to_string(here.join("tiny.toml")).unwrap();
    let sized = "[preprocessing]\nexpected-size = { width = 640, height = 360 }";
    std::fs::write(here.join("sized.toml"), preset.replacen("[preprocessing]", sized, 1)).unwrap();
    let args = ["run", "sized.toml", "--data", "data", "--method", "nearest-view", "--out", "store"];
    atsplat(here, &args).prints(1, "--any-size takes images of any size");
    // A store without results accepts other settings.
    let taken = atsplat(here, &[&args[..], &["--any-size"]].concat());
    assert!(taken.code == 0 && !taken.stdout.contains("--any-size"), "{}{}", taken.stdout, taken.stderr);
}

/// Of four scenes, one is whole, one has lost two images, one is cut off and one has no trajectory.
#[test]
fn strict_fails_on_what_a_sampler_leaves_out() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    dataset(here, &["gaps", "whole"], 9);
    let rule = "[sampler]\nsampler = 'evenly-spaced'\ncontext-views = 2\ntarget-views = 3\n";
    std::fs::write(here.join("rule.toml"), rule).unwrap();
    let check = |store: &str, lacks: &[&str]| {
        let sampled = run(here, &["--sampler", "rule.toml", "--out", store, "--strict"]);
        let page = format!("page-{store}");
        let report = atsplat(here, &["report", store, "--out", &page, "--strict"]);
        let code = if lacks.is_empty() { 0 } else { 4 };
        assert_eq!((sampled.code, report.code), (code, code), "{}{}", sampled.stderr, report.stderr);
        for lack in lacks {
            assert!(sampled.stdout.contains(lack), "{lack}: {}", sampled.stdout);
            let found = report.stderr.lines().any(|line| {
                let (kind, first) = lack.split_once(": ").unwrap();
                let first = first.rsplit(": ").next().unwrap();
                line.starts_with(&format!("warning: {store}: tiny: {kind}: ")) && line.contains(first)
            });
            assert!(found, "{lack}: {}", report.stderr);
        }
        assert_eq!(run(here, &["--sampler", "rule.toml", "--out", store]).code, 0, "not strict");
    };
    check("complete", &[]);
    for gone in [3, 5] {
        std::fs::remove_file(here.join(format!("data/gaps/{}.png", gone * 33_367))).unwrap();
    }
    let frames = "2 frames without an image, which are not sampled: rule.toml";
    check("frames", &[frames]);
    std::fs::create_dir_all(here.join("data/ignored")).unwrap();
    std::fs::write(here.join("data/ignored/0.png"), image(0, SIDE)).unwrap();
    let ignored = "1 scenes that are not read, and not sampled: ignored-scene: ignored";
    check("ignored", &[frames, ignored]);
    dataset(here, &["broken"], 9);
    let trajectory = std::fs::read_to_string(here.join("data/broken.txt")).unwrap();
    std::fs::write(here.join("data/broken.txt"), trajectory.trim_end().rsplit_once(' ').unwrap().0).unwrap();
    check("broken", &[frames, ignored, "1 scenes without an entry in the sampled index: broken"]);
}

#[test]
fn a_mistyped_folder_of_renders_can_be_corrected_in_the_same_store() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    dataset(here, &["one", "two"], 5);
    write_index(&here.join("data"), &["one", "two"], "[0, 4]", "[1, 2]");
    for (scene, frame) in [("one", 1), ("one", 2), ("two", 2)] {
        let place = here.join(format!("out/test/{scene}/color"));
        std::fs::create_dir_all(&place).unwrap();
        std::fs::write(place.join(format!("{frame:06}.png")), image(frame + 1, SIDE)).unwrap();
        std::fs::create_dir_all(here.join(format!("small/{scene}"))).unwrap();
        std::fs::write(here.join(format!("small/{scene}/{frame}.png")), image(frame, 8)).unwrap();
    }
    let score = |renders: &str| {
        let args = ["score", "tiny.toml", "--data", "data", "--name", "theirs", "--out", "store", "--renders", renders];
        atsplat(here, &args)
    };
    let up = score("out");
    assert!(up.code == 1 && !here.join("store").exists(), "{}", up.stderr);
    for text in [
        "folder of renders: expected SCENE/color/000029.png",
        "2 of them below out/test, in the layout SCENE/color/000029.png (2)",
    ] {
        assert!(up.stderr.contains(text), "{text}: {}", up.stderr);
    }
    score("out/test/one").says(1, "out/test, in the layout SCENE/color/000029.png (2)");
    score("data/one").says(1, "the folder contains 0.png");
    // Files of another size give rows without numbers.
    let small = score("small");
    small.says(1, "small: SCENE/29.png (2)");
    assert!(small.stderr.contains("all of 4 targets failed"), "{}", small.stderr);
    for line in [
        "tiny: 3 targets of theirs failed: scene one, frame 1: expected an image of 40×40, found 8×8\n",
        "tiny: 1 target of theirs failed: scene two, frame 1: no file for frame 1 of scene two: expected two/000001.png",
    ] {
        assert!(small.stdout.contains(line), "{line}: {}", small.stdout);
    }

    let corrected = score("out/test");
    assert_eq!(corrected.code, 0, "{}", corrected.stderr);
    let results = Results::read(&here.join("store")).unwrap();
    let scored = results.targets.iter().filter(|row| row.scores.contains_key("psnr")).count();
    assert_eq!((results.targets.len(), scored), (4, 3));
    let said = "imported files of the two runs differ: expected the contents of out/test, found others in small, the first of theirs";
    score("small").says(1, said);
    assert_eq!(Results::read(&here.join("store")).unwrap(), results, "nothing was replaced");
}

#[test]
fn reports_a_changed_protocol_field_by_field() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    dataset(here, &["a"], 5);
    write_index(&here.join("data"), &["a"], "[0, 4]", "[2]");
    assert_eq!(run(here, &["--out", "store"]).code, 0);
    let text = std::fs::read_to_string(here.join("tiny.toml")).unwrap();
    std::fs::write(here.join("tiny.toml"), text.replacen("dilation = 0.3", "dilation = 0.1", 1)).unwrap();
    let other = run(here, &["--out", "store"]);
    other.says(1, "toml.renderer.dilation: 0.3 and 0.1");
    assert!(!other.stderr.contains('{'), "no structure is printed as code: {}", other.stderr);
}

#[test]
fn the_help_of_a_sweep_promises_no_url_as_output() {
    let folder = tempfile::tempdir().unwrap();
    let help = |args: &[&str]| {
        let text = succeed(folder.path(), &[args, &["--help"]].concat());
        // Lines are wrapped at the terminal width.
        text.split_whitespace().collect::<Vec<_>>().join(" ")
    };
    assert!(help(&["run"]).contains("Folder of the results, or a URL (s3://, gs://, az://); an unfinished run"));
    assert!(help(&["tradeoff", "sweep"]).contains("Folder of the results; an unfinished run in it is resumed"));
}

#[test]
fn only_commands_that_can_skip_have_strict() {
    let folder = tempfile::tempdir().unwrap();
    let help = |args: &[&str]| succeed(folder.path(), &[args, &["--help"]].concat());
    for args in [
        &["run"][..],
        &["score"],
        &["reproduce"],
        &["merge"],
        &["expansion"],
        &["report"],
        &["render"],
        &["tradeoff", "sweep"],
        &["data", "inspect"],
        &["data", "motion"],
        &["data", "export"],
        &["protocol", "lint"],
        &["protocol", "overlap"],
        &["protocol", "build"],
        &["protocol", "extrapolate"],
    ] {
        assert!(help(args).contains("--strict"), "{args:?}");
    }
    for args in [
        &[][..],
        &["train"],
        &["drift"],
        &["tradeoff"],
        &["adapters"],
        &["stress"],
        &["budget"],
        &["reconstruct"],
        &["weights", "verify"],
        &["protocol", "list"],
        &["protocol", "show"],
        &["data", "simulate"],
    ] {
        assert!(!help(args).contains("--strict\n") && !help(args).contains("--strict "), "{args:?}");
    }
    atsplat(folder.path(), &["--strict", "run"]).says(2, "'run --strict' exists");
}
