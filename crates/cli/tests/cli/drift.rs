//! `atsplat drift` and `atsplat tradeoff` as a user runs them.

use std::path::Path;

use crate::common::{atsplat, json_of, printed_json, succeed};
use atsplat_results::times::TimingRow;
use atsplat_results::{MethodRecord, PresetRecord, Results, TargetStatus, TrialKey, TrialRow};
use sample_rows::{PRESET, results, timing};

#[path = "../../../results/src/sample_rows.rs"]
mod sample_rows;

/// Two methods on six scenes of two targets; `shift` is added to every PSNR of the first.
fn store(path: &Path, shift: f64) {
    store_of(path, shift, |_| ());
}

/// As [`store`], with a change before it is written.
fn store_of(path: &Path, shift: f64, change: impl FnOnce(&mut Results)) {
    let scenes: Vec<String> = (0..6).map(|scene| format!("scene {scene}")).collect();
    let mut store = Results::default();
    "some".clone_into(&mut store.provenance.processor);
    store.provenance.presets.push(PresetRecord {
        name: PRESET.to_owned(),
        hash: "h".to_owned(),
        toml: atsplat_protocol::Preset::text_of("re10k-2v-256").unwrap().to_owned(),
        ..PresetRecord::default()
    });
    for (method, score, secs, gaussians) in [("fine", 25.0 + shift, 0.4, 40_000), ("coarse", 23.0, 0.1, 10_000)] {
        let of_scene = |at: u32| [at, at + 1].map(|more| score + f64::from(more)).to_vec();
        let rows: Vec<_> = scenes.iter().zip(0..).map(|(scene, at)| (scene.as_str(), 0, of_scene(at))).collect();
        let run = results(method, "psnr", &rows);
        let record = MethodRecord { name: method.to_owned(), deterministic: true, ..MethodRecord::default() };
        store.provenance.methods.push(record);
        store.provenance.metrics = run.provenance.metrics;
        store.trials.extend(run.trials.into_iter().map(|row| TrialRow { gaussians: Some(gaussians), ..row }));
        store.targets.extend(run.targets);
        store.timings.push(TimingRow { trials_there: 6, ..timing(method, "scene 0", &[secs; 5], &[0.01; 5]) });
    }
    store.trials.sort_by(|a, b| a.key.cmp(&b.key));
    store.targets.sort_by(|a, b| (&a.key, a.target).cmp(&(&b.key, b.target)));
    change(&mut store);
    store.write(path).unwrap();
}

#[test]
fn a_baseline_is_accepted_met_and_drifted_from() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    store(&at.join("then"), 0.0);
    store(&at.join("now"), 0.125);
    let accepted = succeed(at, &["drift", "accept", "then", "--baseline", "quick.json", "--why", "the first numbers"]);
    assert!(accepted.contains("24 targets of 12 trials") && accepted.contains("a new baseline"), "{accepted}");
    let size = |name: &str| std::fs::metadata(at.join(name)).unwrap().len();
    assert!(size("quick.json") + size("quick.probe.safetensors") < 1_000_000);

    let calm = succeed(at, &["drift", "then", "--baseline", "quick.json"]);
    assert!(calm.ends_with("Verdict: same\n") && calm.contains("no stage of the probe changed."), "{calm}");

    let outcome = atsplat(at, &["drift", "now", "--baseline", "quick.json", "--json"]);
    assert_eq!(outcome.code, 3, "{}", outcome.stderr);
    let report = json_of(&outcome.stdout);
    assert_eq!(report["verdict"], "drifted", "{report}");
    let moved: Vec<_> =
        report["comparisons"].as_array().unwrap().iter().map(|c| (&c["method"], &c["verdict"])).collect();
    assert_eq!(moved, [(&"coarse".into(), &"same".into()), (&"fine".into(), &"drifted".into())]);
    assert_eq!(report["comparisons"][1]["paired"]["difference"], 0.125);
    assert_eq!(report["attribution"]["stages"].as_array().unwrap().len(), 5);

    let moved = atsplat(at, &["drift", "now", "--baseline", "quick.json"]).stdout;
    assert!(
        moved.contains("no stage of the probe changed. The cause is outside atsplat's pipeline: the method's files"),
        "{moved}"
    );

    // With other constants than the baseline's, the rows are the same but a stage of the probe differs.
    std::fs::write(at.join("probe.toml"), "constants = 'gsplat-1.6'").unwrap();
    let args = ["drift", "then", "--baseline", "quick.json", "--probe", "probe.toml"];
    atsplat(at, &args).prints(3, "The first change is in the renderer: ");

    let args =
        ["drift", "accept", "now", "--baseline", "quick.json", "--why", "a better decoder", "--no-probe", "--json"];
    let report = printed_json(at, &args);
    assert_eq!((&report["moved"], &report["acceptances"]), (&"drifted".into(), &2.into()), "{report}");
    assert!(succeed(at, &["drift", "now", "--baseline", "quick.json"]).ends_with("Verdict: same\n"));
    let text = std::fs::read_to_string(at.join("quick.json")).unwrap();
    assert!(text.contains("the first numbers") && text.contains("a better decoder"), "{text}");
}

/// Of the recipe that is given as of the baseline's own.
#[test]
fn a_probe_that_cannot_be_run_is_an_error_and_no_drift() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    store(&at.join("then"), 0.0);
    succeed(at, &["drift", "accept", "then", "--baseline", "quick.json", "--why", "the first numbers"]);
    let args = ["drift", "then", "--baseline", "quick.json"];
    let fails = |more: &[&str], message: &str| {
        let outcome = atsplat(at, &[&args[..], more].concat());
        let is_error = outcome.code == 1 && outcome.stdout.is_empty() && outcome.stderr.contains(message);
        assert!(is_error, "{more:?}: {} {} {}", outcome.code, outcome.stdout, outcome.stderr);
    };
    std::fs::write(at.join("unknown.toml"), "model = 'nope'").unwrap();
    fails(&["--probe", "unknown.toml"], "--probe unknown.toml: the probe's stage model: ");
    // The stages can be made, but the network's patches do not divide such images.
    let odd = "preprocessing = { steps = [{ step = \"rescale-and-crop\", height = 65, width = 63 }] }";
    std::fs::write(at.join("odd.toml"), odd).unwrap();
    fails(&["--probe", "odd.toml"], "--probe odd.toml: the probe's stage ");
    let text = std::fs::read_to_string(at.join("quick.json")).unwrap();
    let renamed = text.replacen("\"model\": \"nano\"", "\"model\": \"nope\"", 1);
    assert_ne!(text, renamed);
    std::fs::write(at.join("quick.json"), renamed).unwrap();
    fails(&[], "the baseline's probe (--no-probe compares rows alone): the probe's stage model: ");
    // A file that was not committed.
    std::fs::remove_file(at.join("quick.probe.safetensors")).unwrap();
    fails(&[], "the baseline's probe, a file to be committed with it (--no-probe compares rows alone): ");
    assert!(succeed(at, &[&args[..], &["--no-probe"]].concat()).ends_with("Verdict: same\n"));
}

/// A changed image is reported by scene and frame, missing rows as missing, and a comparison without numbers fails.
#[test]
fn distinguishes_changed_data_losses_and_missing_numbers() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    store(&at.join("then"), 0.0);
    succeed(at, &["drift", "accept", "then", "--baseline", "quick.json", "--why", "the first numbers", "--no-probe"]);
    store_of(&at.join("blurred"), 0.0, |results| {
        let trials = results.trials.iter_mut().filter(|row| row.key.scene == "scene 3");
        trials.for_each(|row| row.context_hashes[1] = "blurred".to_owned());
    });
    let outcome = atsplat(at, &["drift", "blurred", "--baseline", "quick.json"]);
    assert_eq!(outcome.code, 3, "{}", outcome.stdout);
    for part in ["sampled: scene scene 3, frame 9 (context)", "The first change is in the data: "] {
        assert!(outcome.stdout.contains(part), "{part}: {}", outcome.stdout);
    }
    store(&at.join("worse"), -0.125);
    let outcome = atsplat(at, &["drift", "worse", "--baseline", "quick.json"]);
    outcome.prints(3, "-0.125 dB");
    assert!(outcome.stdout.contains("DRIFTED, worse"), "{}", outcome.stdout);
    let empty = |results: &mut Results| {
        results.trials.clear();
        results.targets.clear();
    };
    store_of(&at.join("empty"), 0.0, empty);
    atsplat(at, &["drift", "accept", "empty", "--baseline", "empty.json", "--why", "nothing"])
        .says(1, "an empty baseline cannot detect drift");
    let outcome = atsplat(at, &["drift", "empty", "--baseline", "quick.json"]);
    outcome.prints(1, "targets are missing: 12");
    assert!(outcome.stdout.ends_with("Verdict: nothing compared\n"), "{}", outcome.stdout);
}

#[test]
fn github_gets_an_annotation_and_a_summary() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    store(&at.join("then"), 0.0);
    store(&at.join("now"), -0.125);
    succeed(at, &["drift", "accept", "then", "--baseline", "quick.json", "--why", "the first numbers", "--no-probe"]);
    let github = |store: &str, summary: &Path| {
        let mut command = std::process::Command::new(env!("CARGO_BIN_EXE_atsplat"));
        command.current_dir(at).env("GITHUB_STEP_SUMMARY", summary);
        let output = command.args(["drift", store, "--baseline", "quick.json", "--github", "--json"]).output().unwrap();
        serde_json::from_slice::<serde_json::Value>(&output.stdout).unwrap();
        (output.status.code(), String::from_utf8(output.stderr).unwrap())
    };
    let summary = at.join("summary.md");
    std::fs::write(&summary, "of another command\n").unwrap();
    let (code, said) = github("now", &summary);
    assert!(code == Some(3) && said.starts_with("::error file=quick.json,title="), "{said}");
    assert!(said.contains("psnr of fine under sampled: was ") && said.contains(" (-0.125 dB)"), "{said}");
    let text = std::fs::read_to_string(&summary).unwrap();
    assert!(text.starts_with("of another command\n### Drift: DRIFTED\n"), "{text}");
    assert!(text.contains("| sampled | fine | psnr |") && !text.contains("coarse"), "{text}");
    let (code, said) = github("then", &summary);
    assert!(code == Some(0) && said.is_empty(), "{said}");
    let (code, said) = github("now", at);
    assert!(code == Some(3) && said.contains("warning: --github: the summary of the step: "), "{said}");
}

#[test]
fn only_complete_results_are_accepted_strictly() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    store(&at.join("whole"), 0.0);
    store_of(&at.join("broken"), 0.0, |results| {
        results.targets[3].status = TargetStatus::NonFinite;
        results.targets[3].scores.clear();
    });
    let accept = |store| {
        let args = ["drift", "accept", store, "--baseline", "b.json", "--why", "first", "--no-probe", "--strict"];
        atsplat(at, &args)
    };
    let refused = accept("broken");
    assert!(refused.code == 4 && !at.join("b.json").exists(), "{}", refused.stderr);
    assert!(
        refused.stderr.contains("broken: sampled: 1 target of coarse has NaN or infinite samples"),
        "{}",
        refused.stderr
    );
    assert_eq!(accept("whole").code, 0);
}

#[test]
fn plots_the_history_over_acceptances() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    for (name, shift, why) in [("a", 0.0, "the first numbers"), ("b", 0.5, "a better decoder")] {
        store(&at.join(name), shift);
        succeed(at, &["drift", "accept", name, "--baseline", "quick.json", "--why", why, "--no-probe"]);
    }
    store(&at.join("now"), 0.25);
    let args = ["drift", "now", "--baseline", "quick.json", "--history", "plots/psnr.svg"];
    let outcome = atsplat(at, &args);
    assert_eq!(outcome.code, 3, "{}", outcome.stderr);
    let svg = std::fs::read_to_string(at.join("plots/psnr.svg")).unwrap();
    for text in ["fine on sampled; 3 runs; now: drifted", "+0.500 dB: a better decoder", "−0.250 dB"] {
        assert!(svg.contains(text), "{text}: {svg}");
    }
    assert!(!svg.contains("the first numbers"), "nothing moved then");
    succeed(at, &["drift", "b", "--baseline", "quick.json", "--history", "b.png", "--method", "coarse"]);
    assert!(std::fs::read(at.join("b.png")).unwrap().starts_with(b"\x89PNG"));
    atsplat(at, &[&args[..], &["--metric", "beauty"]].concat()).says(2, "expected one of ");
    // A plot that cannot be drawn hides no drift; without drift, it is an error.
    let renamed = atsplat(at, &[&args[..], &["--method", "other"]].concat());
    renamed.prints(3, "DRIFTED");
    assert!(renamed.stderr.contains("warning: --history: ") && renamed.stderr.contains("psnr of fine under sampled"));
    atsplat(at, &["drift", "b", "--baseline", "quick.json", "--history", "c.svg", "--method", "other"])
        .prints(1, "Verdict: same");
    assert!(!at.join("c.svg").exists());
    assert_eq!(atsplat(at, &["drift", "now", "--baseline", "quick.json", "--metric", "psnr"]).code, 2);
}

/// One of twelve renders of a method is lost; the other method is unchanged.
#[test]
fn a_lost_render_has_a_cause_and_is_drift_in_the_plot() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    store(&at.join("then"), 0.0);
    succeed(at, &["drift", "accept", "then", "--baseline", "quick.json", "--why", "the first numbers"]);
    store_of(&at.join("lost"), 0.0, |results| {
        let row = &mut results.targets[6];
        (row.status, row.render_hash) = (TargetStatus::Failed, None);
        row.detail = Some("no file for frame 0 of scene scene 3".to_owned());
        row.scores.clear();
    });
    let args = ["drift", "lost", "--baseline", "quick.json", "--json", "--history"];
    let outcome = atsplat(at, &[&args[..], &["coarse.svg"]].concat());
    assert_eq!(outcome.code, 3, "{}", outcome.stderr);
    let report = json_of(&outcome.stdout);
    let [change] = &report["changes"].as_array().unwrap()[..] else { panic!("{report}") };
    assert_eq!(change["stage"], "outside");
    let detail = "scene 3 0 frame 0: was scored, is now failed: no file for frame 0 of scene scene 3";
    assert!(change["detail"].as_str().unwrap().ends_with(detail), "{change}");
    let coarse = std::fs::read_to_string(at.join("coarse.svg")).unwrap();
    assert!(coarse.contains("coarse on sampled; 2 runs; now: drifted"), "{coarse}");
    assert!(coarse.contains("drift, and what moved the number"), "{coarse}");
    assert_eq!(atsplat(at, &[&args[..], &["fine.svg", "--method", "fine"]].concat()).code, 3);
    let fine = std::fs::read_to_string(at.join("fine.svg")).unwrap();
    assert!(fine.contains("fine on sampled; 2 runs; now: drifted, but not in this number"), "{fine}");
    assert!(!fine.contains("drift, and what moved the number"), "{fine}");
}

/// Six scenes under a method that is not deterministic, and a deterministic one.
fn noisy(path: &Path, shift: f64, change: impl FnOnce(&mut Results)) {
    store_of(path, shift, |results| {
        results.provenance.methods[0].deterministic = false;
        results.provenance.presets[0].entries = 6;
        change(results);
    });
}

/// Keeps the first scenes, as a run with `--limit` or one that was killed.
fn keep(results: &mut Results, scenes: usize) {
    let is_kept = |key: &TrialKey| (0..scenes).any(|scene| key.scene == format!("scene {scene}"));
    results.trials.retain(|row| is_kept(&row.key));
    results.targets.retain(|row| is_kept(&row.key));
}

#[test]
fn limits_come_from_repetitions_of_the_run_alone() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    let accept = |store: &str, repeats: &[&str]| {
        let args = ["drift", "accept", store, "--baseline", "b.json", "--why", "noise", "--no-probe", "--json"];
        let repeats = repeats.iter().flat_map(|repeat| ["--repeat", *repeat]);
        atsplat(at, &args.into_iter().chain(repeats).collect::<Vec<_>>())
    };
    noisy(&at.join("then"), 0.0, |_| ());
    noisy(&at.join("again"), 0.125, |results| results.provenance.presets[0].dataset = "a copy".to_owned());
    noisy(&at.join("copy"), 0.0, |_| ());
    noisy(&at.join("another"), 0.125, |_| ());
    noisy(&at.join("killed"), 0.25, |results| keep(results, 5));
    noisy(&at.join("limited"), 0.25, |results| {
        results.provenance.presets[0].entries = 2;
        keep(results, 2);
    });
    noisy(&at.join("trained"), 0.25, |results| {
        results.provenance.methods[0].weights_sha256 = Some("other".to_owned());
    });
    store(&at.join("calm"), 0.0);
    for (store, repeats, code, message) in [
        ("then", &["again", "killed"][..], 1, "killed: expected a finished run, found a store is not done: 5 of 6"),
        (
            "then",
            &["limited"],
            1,
            "limited: expected a repetition of the run, found preset sampled, entries: 2 instead of 6",
        ),
        ("then", &["trained"], 1, "trained: expected a repetition of the run, found method fine, weights-sha256"),
        ("then", &["./then"], 1, "--repeat ./then is the same store as then"),
        ("then", &["again", "again/"], 1, "--repeat again/ is the same store as again"),
        ("then", &["copy"], 1, "copy: expected a repetition of the run, found a copy of it"),
        (
            "then",
            &["again", "another"],
            1,
            "another: expected a repetition of the run, found a copy of another repetition",
        ),
        ("calm", &["again"], 2, "--repeat has no effect"),
    ] {
        accept(store, repeats).says(code, message);
        assert!(!at.join("b.json").exists(), "{message}");
    }
    let accepted = accept("then", &["again"]);
    assert_eq!(accepted.code, 0, "{}", accepted.stderr);
    let report = json_of(&accepted.stdout);
    let limits = report["limits"].as_array().unwrap().iter();
    let limits: Vec<_> = limits.map(|limit| (&limit["method"], &limit["runs"])).collect();
    assert_eq!(limits, [(&"fine".into(), &2.into())]);
}

#[test]
fn reports_usage_errors_and_broken_files() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    store(&at.join("then"), 0.0);
    std::fs::write(at.join("broken.json"), "{").unwrap();
    for (args, code, message) in [
        (&["drift", "then"][..], 2, "--baseline"),
        (&["drift", "accept", "then", "--baseline", "b.json"], 2, "--why"),
        (&["drift", "accept", "then", "--baseline", "b.json", "--why", ""], 2, "--why"),
        (&["drift", "then", "--baseline", "none.json"], 1, "accept then --baseline none.json --why"),
        (&["drift", "then", "--baseline", "broken.json"], 1, "broken.json"),
        (&["drift", "b.json", "--baseline", "then"], 1, "--baseline: expected a file, found the folder then; "),
        (&["drift", "accept", "nowhere", "--baseline", "b.json", "--why", "x"], 1, "nowhere"),
        (&["tradeoff", "then", "--metric", "beauty"], 2, "ssim"),
        (&["tradeoff", "then", "--metric", "psnr", "--metric", "psnr"], 2, "--metric: psnr is given twice"),
        (&["tradeoff", "then", "--metric", "psnr", "--metric", "PSNR"], 2, "--metric: psnr is given twice"),
        (&["tradeoff", "nowhere"], 1, "nowhere"),
    ] {
        atsplat(at, args).says(code, message);
    }
    assert!(!at.join("b.json").exists(), "nothing is written where nothing was read");
}

#[test]
fn a_frontier_lists_prices() {
    let folder = tempfile::tempdir().unwrap();
    store(&folder.path().join("then"), 0.0);
    atsplat(folder.path(), &["tradeoff", "then"]).prints(
        0,
        "coarse to fine, 2.0000 dB better (2.0000 to 2.0000): the next 0.1 dB for +15.0 ms and +1500 Gaussians",
    );
    let report = printed_json(folder.path(), &["tradeoff", "then", "--json"]);
    let points = report["tradeoffs"][0]["frontiers"][0]["points"].as_array().unwrap();
    assert!(points.len() == 2 && points.iter().all(|point| point["standing"] == "frontier"), "{report}");

    store_of(&folder.path().join("few"), 0.0, |results| keep(results, 5));
    let table = succeed(folder.path(), &["tradeoff", "few"]);
    let unclear = "+2.0000 (no interval with fewer than 6 scenes) from coarse, not distinguishable";
    assert!(table.contains(unclear) && table.contains("no price"), "{table}");
}

#[test]
fn a_limit_is_stated_once_for_a_metric_and_stays() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    noisy(&at.join("then"), 0.0, |_| ());
    noisy(&at.join("again"), 0.125, |_| ());
    store(&at.join("calm"), 0.0);
    let accept = |store: &str, more: &[&str]| {
        let args = ["drift", "accept", store, "--baseline", "b.json", "--why", "noise", "--no-probe"];
        atsplat(at, &[&args[..], more].concat())
    };
    for (store, limits, code, message) in [
        ("then", &["--limit", "psnr=0.05", "--limit", "psnr=0.5"][..], 2, "--limit: psnr is given twice"),
        ("then", &["--limit", "psnr"], 2, "expected METRIC=CHANGE, such as psnr=0.05"),
        ("then", &["--limit", "psnr=-0.05"], 2, "-0.05"),
        ("then", &["--limit", "lpips=0.05"], 1, "limit: expected a metric with a limit: one of psnr, found lpips"),
        ("calm", &["--limit", "psnr=0.05"], 1, "limit: expected a method that is not deterministic, found none"),
    ] {
        accept(store, limits).says(code, message);
        assert!(!at.join("b.json").exists(), "{message}");
    }
    let said = |more: &[&str]| {
        let outcome = accept("then", more);
        assert_eq!(outcome.code, 0, "{}", outcome.stderr);
        outcome.stdout
    };
    let stated = "sampled, fine: psnr may vary by 0.05 dB, as stated\n";
    for (more, is_stated) in
        [(&["--limit", "psnr=0.05"][..], true), (&[][..], true), (&["--repeat", "again"][..], false), (&[][..], false)]
    {
        let said = said(more);
        assert_eq!(said.contains(stated), is_stated, "{more:?}: {said}");
    }
}
