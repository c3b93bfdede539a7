//! `atsplat tradeoff` on settings without a result.

use std::path::Path;

use crate::common::{Outcome, atsplat, json_of, succeed};
use crate::evaluation::write_noise;
use atsplat_model::weights::ModelWeights;
use atsplat_results::Results;

/// A sweep of what [`sweep`] has written; the folder of its results follows.
const SWEEP: [&str; 8] = ["tradeoff", "sweep", "tiny.toml", "--data", "data", "--sweep", "sweep.toml", "--out"];
const NETWORK: [&str; 4] = ["--weights", "random:1", "--metrics", "psnr"];

fn sweep(here: &Path, settings: &str, out: &str, more: &[&str]) -> Outcome {
    std::fs::write(here.join("sweep.toml"), format!("title = 'settings'\n{settings}")).unwrap();
    atsplat(here, &[&SWEEP[..], &[out], &NETWORK, more].concat())
}

/// Images that the network cannot divide into patches.
const ODD: &str = "[[settings]]\nlabel = 'odd'\noverrides = { resolution = [20, 24] }\n";
const WHOLE: &str = "[[settings]]\nlabel = 'whole'\n";

#[test]
fn a_setting_without_a_result_tells_why() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    write_noise(here, 1);
    let why = "nothing was scored: 8 targets not supported, the first with: model input: ";
    let both = sweep(here, &[WHOLE, ODD].concat(), "both", &[]);
    assert_eq!(both.code, 0, "{}", both.stderr);
    let row = both.stdout.lines().find(|line| line.starts_with("- odd, tiny-20x24 "));
    let row = row.unwrap_or_else(|| panic!("{}", both.stdout));
    assert!(row.contains(why) && row.contains("divisible by"), "{row}");
    assert!(both.stdout.contains("* whole, tiny "), "{}", both.stdout);

    let alone = sweep(here, ODD, "alone", &["--json"]);
    assert_eq!(alone.code, 1, "{}", alone.stdout);
    let report = json_of(&alone.stdout);
    let tradeoff = &report["tradeoffs"][0];
    for reason in [&tradeoff["frontiers"][0]["left-out"][0], &tradeoff["unscored"][0]] {
        let text = reason[1].as_str().unwrap();
        assert!(reason[0] == "odd" && why.contains(&text[..20]) && text.contains("found 20x24"), "{reason}");
    }
    let error =
        "error: no setting has a result: tiny-20x24, psnr, odd: 8 targets not supported, the first with: model ";
    assert!(alone.stderr.contains(error), "{}", alone.stderr);
    atsplat(here, &["tradeoff", "alone"]).says(1, "error: nothing was scored: tiny-20x24, psnr, odd: 8 targets");
}

/// Images are not enlarged, so that the first setting has no trial; the second has its results nevertheless.
#[test]
fn a_setting_without_a_trial_does_not_end_the_sweep() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    write_noise(here, 1);
    let large = "[[settings]]\nlabel = 'large'\noverrides = { resolution = [64, 64] }\n";
    let why = "large: nothing was evaluated: tiny-64x64: every entry was skipped: 1 preprocessing (frame 0: ";
    let both = sweep(here, &[large, WHOLE].concat(), "both", &[]);
    both.says(0, &format!("warning: {why}"));
    assert!(both.stdout.contains("* whole, tiny "), "{}", both.stdout);
    let error = format!("error: no setting has a result: {why}");
    sweep(here, large, "alone", &[]).says(1, &error);
    let store = atsplat(here, &["tradeoff", "alone"]);
    let error = "error: nothing was scored: no method has a trial";
    store.says(1, error);
    assert!(!store.stderr.contains("frontier is empty"), "said once: {}", store.stderr);
}

#[test]
fn a_metric_that_was_not_computed_is_a_reason() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    write_noise(here, 1);
    let whole = sweep(here, WHOLE, "whole", &[]);
    assert_eq!(whole.code, 0, "{}", whole.stderr);
    let reason = "whole: 8 targets not computed, the first with: weights absent\n";
    let lpips = atsplat(here, &["tradeoff", "whole", "--metric", "lpips"]);
    assert!(lpips.code == 1 && lpips.stderr.ends_with(&format!("tiny, lpips, {reason}")), "{}", lpips.stderr);
    let row = format!("- {:<40} skipped: nothing was scored: {}", "whole", reason.strip_prefix("whole: ").unwrap());
    assert!(lpips.stdout.contains(&row), "{}", lpips.stdout);
    atsplat(here, &["tradeoff", "whole", "--metric", "lpips", "--metric", "psnr"]).prints(0, &row);
}

#[test]
fn a_setting_needs_a_label() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    write_noise(here, 1);
    for label in ["", "  "] {
        let error = format!("settings, number 2: expected a label with text, found {label:?}");
        sweep(here, &format!("{WHOLE}[[settings]]\nlabel = '{label}'\n"), "out", &[]).says(1, &error);
        assert!(!here.join("out").exists(), "nothing is run");
    }
}

/// With a strategy, random points are optimised.
#[test]
fn a_sweep_without_a_network_takes_no_options_of_one() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    write_noise(here, 1);
    let optimised = "[[settings]]\nlabel = 'scratch'\noverrides = { strategy = 'mip-splatting', steps = 2 }\n";
    sweep(here, optimised, "out", &[]).says(2, "--weights requires a setting of --sweep without `strategy`");
    assert!(succeed(here, &[&SWEEP[..], &["out"], &NETWORK[2..]].concat()).contains("* scratch "));
    let both = sweep(here, &[WHOLE, optimised].concat(), "both", &[]);
    assert_eq!(both.code, 0, "{}", both.stderr);
    atsplat(here, &[&SWEEP[..], &["none"]].concat()).says(1, "--weights is required");
}

#[test]
fn options_that_every_setting_overrides_are_reported() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    write_noise(here, 1);
    let own = "[[settings]]\nlabel = 'own'\noverrides = { thresholds = [0.1, 0.1, 0.4] }\n";
    for (settings, out, expected) in [(own.to_owned(), "own", true), ([own, WHOLE].concat(), "both", false)] {
        let outcome = sweep(here, &settings, out, &["--ratios", "0.5,0.5,0.25"]);
        let reported =
            outcome.stderr.contains("note: --ratios has no effect: every setting that runs a network has its own");
        assert_eq!((outcome.code, reported), (0, expected), "{}", outcome.stderr);
    }
}

/// The label of the second part would be the name of a folder of images.
#[test]
fn what_a_sweep_rejects_is_rejected_before_its_first_part_runs() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    write_noise(here, 1);
    let truth = "[[settings]]\nlabel = 'truth'\noverrides = { resolution = [16, 16] }\n";
    sweep(here, &[WHOLE, truth].concat(), "out", &[]).says(1, "other names than truth and context");
    assert!(!here.join("out").exists(), "nothing is run");
}

/// The base is untrained and sees images of any size as given; options of the network are of all settings.
#[test]
fn weights_of_a_setting_run_with_the_options_of_the_command() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    write_noise(here, 1);
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../eval/checkpoints/micro-rooms.safetensors");
    let settings = format!("{WHOLE}[[settings]]\nlabel = 'micro'\noverrides = {{ weights = '{}' }}\n", file.display());
    let outcome = sweep(here, &settings, "out", &["--expand-first", "1"]);
    assert_eq!(outcome.code, 0, "{}", outcome.stderr);
    let methods = Results::read(&here.join("out")).unwrap().provenance.methods;
    let micro = methods.iter().find(|method| method.name == "micro").unwrap();
    let stored = ModelWeights::read(&file).unwrap().config;
    assert_eq!(micro.model_hash(), Some(stored.with_expansion_in_first(1).hash().unwrap().as_str()));
    assert_eq!(micro.parameters["context-at-scale-of"], stored.resolution.to_string());
    assert!(methods.iter().any(|method| method.name == "whole" && !method.parameters.contains_key(LARGE)));
}

/// The parameter with the configuration for large images.
const LARGE: &str = "high-resolution";

/// With the options of the network.
#[test]
fn trained_networks_have_the_setting_for_large_images() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    write_noise(here, 1);
    let large = |out: &str, more: &[&str]| {
        let args = ["run", "tiny.toml", "--data", "data", "--method", "atsplat", "--metrics", "psnr", "--out", out];
        // What is recorded does not depend on the images.
        atsplat(here, &[&args[..], more].concat());
        let method = Results::read(&here.join(out)).unwrap().provenance.methods.remove(0);
        method.parameters.get(LARGE).cloned()
    };
    let found = large("changed", &["--weights", "micro-rooms", "--ratios", "0.25,0.5,0.25"]).unwrap();
    let blocks = found["decoder"]["blocks"].as_array().unwrap();
    let first = blocks.iter().find(|block| !block["expansion"].is_null()).unwrap();
    assert_eq!(found["coarse"]["image-downscale"], 2);
    assert_eq!(first["expansion"]["ratio"], 0.25);
    assert_eq!(large("given", &["--weights", "micro-rooms", "--context-size", "given"]), None);
    assert_eq!(large("random", &["--weights", "random:1"]), None);
}

/// As `run` does: a shard is complete without the others, and one that is smaller than a scene is empty.
#[test]
fn shards_of_a_sweep_are_complete_each() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    write_noise(here, 1);
    let whole = sweep(here, WHOLE, "first", &["--shard", "1/2", "--strict"]);
    let empty = sweep(here, WHOLE, "second", &["--shard", "2/2", "--strict"]);
    let mut codes = [whole.code, empty.code];
    codes.sort_unstable();
    assert_eq!(codes, [0, 0], "{}{}", whole.stderr, empty.stderr);
    let said = [&whole, &empty].map(|outcome| outcome.stderr.contains("nothing was evaluated"));
    assert_eq!(said.iter().filter(|said| **said).count(), 1, "{}{}", whole.stderr, empty.stderr);
    assert_eq!(
        sweep(here, ODD, "odd", &["--shard", "1/2"]).code + sweep(here, ODD, "odd-2", &["--shard", "2/2"]).code,
        1
    );
}

/// Six scenes, so that the difference between both has an interval; the images of the second are its own results.
#[test]
fn stated_costs_of_images_are_compared_and_said_to_be_stated() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    write_noise(here, 6);
    let images = ["--metrics", "psnr", "--keep-images", "all"];
    succeed(
        here,
        &[&["run", "tiny.toml", "--data", "data", "--method", "nearest-view,warp", "--out", "own"], &images[..]]
            .concat(),
    );
    let score = |name: &str, costs: &[&str]| {
        let renders = format!("own/images/tiny/{name}");
        let args = ["score", "tiny.toml", "--data", "data", "--renders", &renders, "--name", name, "--out", "scores"];
        atsplat(here, &[&args[..], &["--metrics", "psnr"], costs].concat())
    };
    let on_card = ["--stated-machine", "a card", "--stated-seconds"];
    let costs = |count, secs| [&on_card[..], &[secs, "--stated-gaussians", count]].concat();
    let scored = score("warp", &costs("400", "0.25"));
    let time = "tiny, warp: encoding 250.00 ms, as stated\na card (stated, not measured here)\n";
    assert!(scored.code == 0 && scored.stdout.contains(time), "{}: {}", scored.stdout, scored.stderr);
    let with_rendering = [&costs("300", "0.75")[..], &["--stated-render-seconds", "0.05"]].concat();
    assert_eq!(score("nearest-view", &with_rendering).code, 0);
    assert_eq!(score("warp", &["--stated-gaussians", "0"]).code, 2, "a method without Gaussians states none");

    score("warp", &["--stated-seconds", "0.25"]).says(2, "--stated-machine");
    let expected = "expected 0 or 1e-9 to 1e9 seconds, found \"";
    for secs in ["1e-300", "5e-324", "1e300", "-1", "NaN"] {
        let whole = score("warp", &costs("400", secs));
        let image = score("warp", &[&costs("400", "0.25")[..], &["--stated-render-seconds", secs]].concat());
        for rejected in [whole, image] {
            rejected.says(2, expected);
        }
    }
    let args = ["score", "tiny.toml", "--data", "data", "--ply", "data", "--out", "ply", "--stated-gaussians", "5"];
    atsplat(here, &args).says(2, "--stated-gaussians requires --renders");

    let printed = succeed(here, &["tradeoff", "scores"]);
    for (name, ms, count) in [("warp", " 250.0 ", "400"), ("nearest-view", " 800.0 ", "300")] {
        let rows = printed.lines().filter(|line| line.contains(name) && line.contains(ms) && line.contains(count));
        assert_eq!(rows.count(), 2, "against seconds and Gaussians: {printed}");
    }
    assert!(printed.contains("a card (stated, not measured here)"), "{printed}");
    assert!(printed.contains("warp: Gaussians stated, not counted"), "{printed}");
    let without_rendering: Vec<&str> = printed.lines().filter(|line| line.contains("of the Gaussians alone")).collect();
    let note = "  warp: time of the Gaussians alone, because none was stated for rendering";
    assert_eq!(without_rendering, [note], "{printed}");

    // Without other renders, costs can be stated later, or corrected.
    assert_eq!(score("warp", &costs("500", "0.25")).code, 0);
    succeed(here, &["report", "scores", "--out", "page"]);
    let table = std::fs::read_to_string(here.join("page/tables/protocol-tiny.md")).unwrap();
    let row = table.lines().find(|line| line.starts_with("| warp")).unwrap();
    assert!(row.contains("500") && row.contains("0.25"), "{table}");
    let notes: Vec<&str> = table.lines().filter(|line| line.contains("stated, not ")).collect();
    assert!(notes.len() == 2 && notes.iter().all(|note| note.contains("warp")), "one for both methods: {table}");
    assert!(notes[0].ends_with(": a card (stated, not measured here)"), "{table}");
    assert!(notes[1].ends_with(": Gaussians stated, not counted"), "{table}");
}
