use atsplat_files::date;
use atsplat_numeric::{SplitMix64, Tolerance};
use atsplat_results::{MethodRecord, MetricRecord, PresetRecord, Results, TargetStatus, TrialKey, TrialStatus};

use super::probe::{Inputs, Pipeline, Recipe, Stage, run};
use super::*;
use sample_rows::{PRESET, results};

mod accepted;
mod agreement;
mod baseline_files;
mod causes;
mod changes;
mod data;
mod directions;
mod github;
mod grouping;
mod history;
mod lost;
mod machines;
mod planted;
mod repetition;
#[path = "../../../results/src/sample_rows.rs"]
#[expect(dead_code, reason = "times are not compared")]
mod sample_rows;

fn acceptance(reason: &str) -> Acceptance {
    Acceptance { date: date(0), reason: reason.to_owned(), atsplat: "0.1.0".to_owned(), commit: None }
}

/// A first baseline without repetitions.
fn baseline_of(results: &Results) -> Baseline {
    Baseline::new(results, &[], acceptance("first"))
}

/// Adds the record of the method `m`.
fn add_method(results: &mut Results, deterministic: bool) {
    results.provenance.methods.push(MethodRecord { name: "m".to_owned(), deterministic, ..MethodRecord::default() });
}

/// Three targets per scene with fixed scores plus seeded noise.
fn store(deterministic: bool, scenes: u64, noise: f64, seed: u64) -> Results {
    let mut random = SplitMix64::new(seed);
    let mut unit = || random.unit() - 0.5;
    let names: Vec<String> = (0..scenes).map(|scene| format!("scene {scene:03}")).collect();
    let scores = |scene: u64| (0..3).map(|at| 20.0 + ((scene * 7 + at * 3) % 11) as f64).collect::<Vec<_>>();
    let rows = names.iter().zip(0..).map(|(name, scene)| (name.as_str(), 0, scores(scene)));
    let mut base = results("m", "psnr", &rows.collect::<Vec<_>>());
    for row in &mut base.targets {
        row.scores.values_mut().for_each(|score| *score += noise * unit());
        row.render_hash = row.scores.values().next().map(ToString::to_string);
    }
    add_method(&mut base, deterministic);
    let preset = PresetRecord { name: PRESET.to_owned(), hash: "a".to_owned(), ..PresetRecord::default() };
    base.provenance.presets.push(preset);
    base.provenance.processor = "this one".to_owned();
    base
}

fn moved(by: f64) -> Results {
    let mut base = store(true, 12, 0.0, 1);
    shift(&mut base, by);
    base
}

/// Adds an amount to every score.
fn shift(results: &mut Results, by: f64) {
    results.targets.iter_mut().for_each(|row| row.scores.values_mut().for_each(|score| *score += by));
}

/// The keys of all rows of trials and targets.
fn keys(results: &mut Results) -> impl Iterator<Item = &mut TrialKey> {
    let of_trials = results.trials.iter_mut().map(|row| &mut row.key);
    of_trials.chain(results.targets.iter_mut().map(|row| &mut row.key))
}

/// Adds the rows of a run as those of another method.
fn add_rows(results: &mut Results, mut run: Results, method: &str) {
    keys(&mut run).for_each(|key| key.method = method.to_owned());
    results.trials.extend(run.trials);
    results.targets.extend(run.targets);
}

/// What accepting results with these repetitions as the first baseline prints.
fn summary(results: &Results, repeats: &[Results]) -> String {
    let baseline = Baseline::new(results, repeats, acceptance("first"));
    let accepted = acceptance("first");
    AcceptanceReport::new(std::path::Path::new("b.json"), baseline, accepted, results, repeats, None).to_string()
}

fn kinds(report: &DriftReport) -> Vec<(FindingKind, DriftVerdict, u64)> {
    report.findings.iter().map(|finding| (finding.kind, finding.verdict, finding.count)).collect()
}

#[test]
fn equal_rows_are_the_same_in_any_order() {
    let base = store(true, 12, 0.0, 1);
    let baseline = baseline_of(&base);
    let mut again = base.clone();
    again.targets.reverse();
    again.trials.reverse();
    (again.provenance.threads, again.provenance.started) = (7, 1_800_000_000);
    let report = compare(&again, &baseline);
    assert_eq!(
        (report.verdict, report.findings.len(), report.differences.len()),
        (DriftVerdict::Same, 0, 0),
        "{report}"
    );
    let [comparison] = &report.comparisons[..] else { panic!("{report}") };
    assert_eq!((comparison.basis, comparison.changed), (Basis::Exact, 0));
    assert_eq!(comparison.paired.as_ref().map(|paired| (paired.ties, paired.targets)), Some((12, 36)));
}

/// Of six targets, two of the first trial failed and one of the second is not finite.
#[test]
fn an_acceptance_names_targets_without_a_score() {
    let mut base = store(true, 2, 0.0, 1);
    let text = |results: &Results| summary(results, &[]);
    let whole = text(&base);
    assert!(whole.starts_with("b.json: 6 targets of 2 trials, accepted on ") && !whole.contains("warning"), "{whole}");
    for (row, status) in [(0, TargetStatus::Failed), (1, TargetStatus::Failed), (3, TargetStatus::NonFinite)] {
        base.targets[row].status = status;
        base.targets[row].scores.clear();
    }
    let [failed, non_finite] = ["2 targets failed", "1 target with NaN or infinite samples"]
        .map(|text| format!("warning: without a score: {text}\n"));
    let partial = text(&base);
    assert!(partial.contains(&format!("{failed}{non_finite}")), "{partial}");
    base.trials[0].status = TrialStatus::NotApplicable;
    let unsupported = text(&base);
    assert!(!unsupported.contains(&failed) && unsupported.contains(&non_finite), "{unsupported}");
}

/// Neither trial has a score in either run, and one of them is of another kind now.
#[test]
fn a_method_that_fails_where_it_was_not_applicable_has_drifted() {
    let with = |statuses: [TrialStatus; 2]| {
        let mut base = store(true, 4, 0.0, 1);
        for row in &mut base.targets[..6] {
            row.status = TargetStatus::Failed;
            row.scores.clear();
        }
        for (trial, status) in base.trials.iter_mut().zip(statuses) {
            trial.status = status;
        }
        base
    };
    let baseline = baseline_of(&with([TrialStatus::Failed, TrialStatus::NotApplicable]));
    let findings = |second| compare(&with([TrialStatus::Failed, second]), &baseline).findings;
    assert!(findings(TrialStatus::NotApplicable).is_empty());
    let found = findings(TrialStatus::Failed).swap_remove(0);
    assert_eq!((found.kind, found.verdict, found.count), (FindingKind::Status, DriftVerdict::Drifted, 3));
    assert_eq!(found.example, "scene 001 0 frame 0: was not-applicable, is now failed");
}

#[test]
fn a_single_bit_is_drift_for_deterministic_methods() {
    let base = store(true, 12, 0.0, 1);
    let baseline = baseline_of(&base);
    let mut now = base.clone();
    let score = now.targets[7].scores.get_mut("psnr").unwrap();
    *score = score.next_up();
    let report = compare(&now, &baseline);
    assert!(report.drifted(), "{report}");
    assert_eq!(
        (report.comparisons[0].changed, report.comparisons[0].largest_at.as_deref()),
        (1, Some("scene 002 0 frame 1"))
    );
    let mut bits = base.clone();
    bits.targets[3].render_hash = Some("other".to_owned());
    assert_eq!(kinds(&compare(&bits, &baseline)), [(FindingKind::Render, DriftVerdict::Drifted, 1)]);
}

#[test]
fn another_machine_is_compared_by_bound_and_limit() {
    let baseline = baseline_of(&store(true, 12, 0.0, 1));
    let report = |by: f64| {
        let mut base = moved(by);
        base.provenance.processor = "another".to_owned();
        compare(&base, &baseline)
    };
    for (by, expected) in [
        (0.0, DriftVerdict::Same),
        (5e-4, DriftVerdict::Within),
        (5e-3, DriftVerdict::Within),
        (0.02, DriftVerdict::Drifted),
    ] {
        let report = report(by);
        assert_eq!((report.verdict, report.comparisons[0].basis), (expected, Basis::Bound), "{by}: {report}");
    }
    assert_eq!(report(0.0).differences[0].what(), "processor");
}

#[test]
fn changes_other_than_scores_are_found() {
    let base = store(true, 4, 0.0, 1);
    let baseline = baseline_of(&base);
    let mut now = base.clone();
    now.targets[0].truth_hash = Some("other".to_owned());
    now.targets[4].scores.insert("ssim".to_owned(), 0.5);
    now.targets[1].status = TargetStatus::Failed;
    now.targets[2].scores.clear();
    now.targets[11].target = 9;
    now.trials[0].trial_hash = "other".to_owned();
    now.trials[1].gaussians = Some(1);
    now.provenance.presets[0].hash = "b".to_owned();
    let report = compare(&now, &baseline);
    let expected = [
        (FindingKind::Protocol, DriftVerdict::Drifted, 1),
        (FindingKind::Data, DriftVerdict::Drifted, 1),
        (FindingKind::Missing, DriftVerdict::Drifted, 1),
        (FindingKind::New, DriftVerdict::Within, 1),
        (FindingKind::Trial, DriftVerdict::Drifted, 1),
        (FindingKind::Status, DriftVerdict::Drifted, 1),
        (FindingKind::Count, DriftVerdict::Drifted, 1),
        (FindingKind::Score, DriftVerdict::Drifted, 1),
        (FindingKind::NewScore, DriftVerdict::Within, 1),
    ];
    assert_eq!(kinds(&report), expected, "{report}");
    assert!(report.differences.iter().any(|difference| difference.what() == format!("preset {PRESET}, hash")));
    let nothing = compare(&Results::default(), &baseline);
    assert_eq!(kinds(&nothing), [(FindingKind::Missing, DriftVerdict::Drifted, 12)]);
    assert!(nothing.verdict == DriftVerdict::Nothing && nothing.comparisons[0].paired.is_none(), "{nothing}");
    assert_eq!(nothing.comparisons[0].verdict, DriftVerdict::Nothing, "an empty comparison is not the same");
}

#[test]
fn comparing_nothing_is_not_the_same() {
    let empty = Baseline::new(&Results::default(), &[], acceptance("nothing"));
    let report = compare(&Results::default(), &empty);
    assert_eq!((report.verdict, report.drifted()), (DriftVerdict::Nothing, false), "{report}");
    assert!(report.to_string().ends_with("Verdict: nothing compared\n"), "{report}");
    let report = compare(&store(true, 4, 0.0, 1), &empty);
    assert_eq!(kinds(&report), [(FindingKind::New, DriftVerdict::Within, 12)]);
    assert_eq!(report.verdict, DriftVerdict::Nothing, "what is new was compared with nothing");
    // Everything failed in both runs.
    let mut failed = store(true, 4, 0.0, 1);
    for row in &mut failed.targets {
        row.status = TargetStatus::Failed;
        row.scores.clear();
    }
    let report = compare(&failed, &Baseline::new(&failed, &[], acceptance("failures")));
    assert_eq!((report.verdict, report.findings.len()), (DriftVerdict::Nothing, 0), "{report}");
}

#[test]
fn reports_have_human_readable_numbers() {
    let mut base = store(true, 12, 0.0, 1);
    base.targets.iter_mut().for_each(|row| row.scores.values_mut().for_each(|score| *score = 21.969_999_999));
    let parameters = |threshold: f32| {
        let json = serde_json::json!({ "thresholds": { "first": f64::from(threshold) }, "name": "small" });
        [("configuration".to_owned(), json)].into_iter().collect()
    };
    base.provenance.methods[0].parameters = parameters(0.05);
    let baseline = baseline_of(&base);
    shift(&mut base, -0.125);
    base.provenance.methods[0].parameters = parameters(0.1);
    let report = compare(&base, &baseline).to_string();
    let limit = Limit {
        preset: "p".to_owned(),
        method: "m".to_owned(),
        metric: "psnr".to_owned(),
        limit: least_limit("psnr"),
        origin: LimitOrigin::Least,
        scene: None,
    };
    assert_eq!(limit.to_string(), "p, m: psnr may vary by 0.01 dB, the least limit");
    for part in ["21.97 dB", "21.84 dB", "-0.125 dB", "largest change 0.12 dB at scene 000 0 frame 0", "DRIFTED, worse"]
    {
        assert!(report.contains(part), "{part}: {report}");
    }
    assert!(report.contains("method m, configuration.thresholds.first: was 0.05, is now 0.1"), "{report}");
    assert!(!report.contains("name"), "what is the same is not listed: {report}");
}

/// Three of four entries move by 4 dB, all of one scene: their mean moves by 3 dB, a mean over the two scenes by 2 dB.
#[test]
fn limits_are_of_the_mean_that_is_compared() {
    let run = |by: f64| {
        let entry = |number, score: f64| ("a", number, vec![score + by]);
        let rows = [entry(0, 20.0), entry(1, 22.0), entry(2, 24.0), ("b", 0, vec![30.0])];
        let mut made = results("m", "psnr", &rows);
        add_method(&mut made, false);
        made
    };
    let (first, second) = (run(0.0), run(4.0));
    let baseline = Baseline::new(&first, std::slice::from_ref(&second), acceptance("first"));
    let moved = compare(&second, &baseline).comparisons[0].paired.as_ref().map(|paired| paired.difference);
    Tolerance::F64.assert(moved, [3.0], "difference");
    Tolerance::absolute(1e-9).assert([baseline.limits[0].limit], [4.0 * 3.0], "four times the difference of two runs");
}

/// Runs with the same noise as those behind the limits are not drift; a much larger shift is.
#[test]
fn noise_is_not_drift_and_a_shift_is() {
    let run = |seed| store(false, 20, 0.5, seed);
    let repeats: Vec<Results> = (2..5).map(run).collect();
    let baseline = Baseline::new(&run(1), &repeats, acceptance("first"));
    let [limit] = &baseline.limits[..] else { panic!("{:?}", baseline.limits) };
    assert!(
        limit.origin == LimitOrigin::Estimated(4) && limit.limit > least_limit("psnr") && limit.limit < 0.5,
        "{limit:?}"
    );
    for seed in 10..20 {
        let report = compare(&run(seed), &baseline);
        assert_eq!((report.verdict, report.comparisons[0].basis), (DriftVerdict::Within, Basis::Interval), "{report}");
    }
    for side in [-1.0, 1.0] {
        let mut shifted = run(30);
        let by = side * (2.0 * limit.limit + 0.3);
        shift(&mut shifted, by);
        assert!(compare(&shifted, &baseline).drifted(), "{by}");
    }
}

#[test]
fn results_without_scores_and_unfinished_runs_cannot_become_a_baseline() {
    let whole = store(true, 4, 0.0, 1);
    acceptable(&whole).unwrap();
    let mut killed = whole.clone();
    killed.provenance.presets[0].entries = 5;
    let error = acceptable(&killed).unwrap_err().to_string();
    assert!(error.starts_with("expected a finished run, found a store is not done: 4 of 5 entries of"), "{error}");
    let mut empty = whole;
    empty.targets.iter_mut().for_each(|row| row.scores.clear());
    let error = acceptable(&empty).unwrap_err().to_string();
    assert!(error.starts_with("expected results with scores, found 12 targets without scores;"), "{error}");
}

#[test]
fn every_acceptance_records_its_numbers() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("quick.json");
    let first = baseline_of(&moved(0.0));
    let second = first.accept(&moved(0.5), &[], acceptance("a better filter"));
    let third = second.accept(&moved(0.5), &[], acceptance("a new machine"));
    let now = moved(0.25);
    let history = |baseline: &Baseline| {
        let mut all = histories(baseline, &compare(&now, baseline));
        assert_eq!(all.len(), 1);
        all.remove(0)
    };
    let found = history(&third);
    let mean = first.numbers[0].mean;
    let moves: Vec<_> = found.runs.iter().map(|run| (run.moved, run.verdict, run.why.as_deref())).collect();
    assert_eq!(
        moves,
        [
            (None, None, Some("first")),
            (Some(0.5), Some(DriftVerdict::Drifted), Some("a better filter")),
            (Some(0.0), Some(DriftVerdict::Same), Some("a new machine")),
            (Some(-0.25), Some(DriftVerdict::Drifted), None),
        ]
    );
    let limits: Vec<_> = found.runs.iter().map(|run| run.limits).collect();
    assert_eq!(limits, [None, Some([mean; 2]), Some([mean + 0.5; 2]), Some([mean + 0.5; 2])], "every bit counts");
    assert_eq!((found.unknown, found.verdict, found.runs[3].label.as_str()), (0, DriftVerdict::Drifted, "now"));

    // A file of a format without numbers has those of its last acceptance in its rows, and later ones are added.
    third.write(&path).unwrap();
    let text = std::fs::read_to_string(&path).unwrap();
    let (head, rest) = text.split_once("  \"numbers\": [").unwrap();
    let (_, tail) = rest.split_once("],\n").unwrap();
    std::fs::write(&path, format!("{head}{tail}").replace("\"format\": 3", "\"format\": 1")).unwrap();
    let old = Baseline::read(&path).unwrap();
    assert_eq!((&old.trials, &old.targets), (&third.trials, &third.targets));
    let found = history(&old.accept(&moved(0.0), &[], acceptance("back")));
    let known: Vec<_> = found.runs.iter().map(|run| (run.why.as_deref(), run.moved)).collect();
    assert_eq!(known, [(Some("a new machine"), None), (Some("back"), Some(-0.5)), (None, Some(0.25))]);
    assert_eq!(found.unknown, 2);
}

#[test]
fn history_limits_are_those_of_the_previous_baseline() {
    let runs: Vec<Results> = (0..3).map(|seed| store(false, 12, 0.3, seed)).collect();
    let baseline = Baseline::new(&runs[0], &runs[1..], acceptance("first"));
    let limit = baseline.limits[0].limit;
    let report = compare(&runs[1], &baseline);
    let found = histories(&baseline, &report).remove(0);
    let mean = found.runs[0].mean;
    assert_eq!(found.runs[1].limits, Some([mean - limit, mean + limit]));
    assert_eq!(found.runs[1].verdict, Some(DriftVerdict::Within));
    let nothing = Results { targets: Vec::new(), ..runs[1].clone() };
    let found = histories(&baseline, &compare(&nothing, &baseline)).remove(0);
    assert_eq!(found.runs.len(), 1, "a missing number has no current run");
}

/// Rows from the probe's stages, their baseline on disk, and a renderer constant increased by a thousandth: the number has
/// drifted, and the stage is named.
#[test]
fn a_changed_number_is_traced_to_its_stage() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("probe.json");
    let (recipe, inputs) = (Recipe::default(), Inputs::pattern(&atsplat_splat::RendererConstants::default()).unwrap());
    let pipeline = Pipeline::of(&recipe).unwrap();
    let rows = |pipeline: &Pipeline| {
        let outputs = run(pipeline, &inputs).unwrap();
        let mut base = results("m", "psnr", &[("pattern", 0, vec![outputs.scores[0]["psnr"]])]);
        add_method(&mut base, true);
        (base, outputs)
    };
    let (base, outputs) = rows(&pipeline);
    let (accepted, values) = baseline_of(&base).with_probe(recipe, &outputs).unwrap();
    accepted.write_with_probe(&path, &values).unwrap();

    let baseline = Baseline::read(&path).unwrap();
    let (recipe, probe) = baseline.read_probe(&path).unwrap().unwrap();
    let mut pipeline = Pipeline::of(&recipe).unwrap();
    let unchanged = compare(&rows(&pipeline).0, &baseline).with_probe(&pipeline, &probe, true);
    assert_eq!(unchanged.verdict, DriftVerdict::Same, "{unchanged}");

    pipeline.options.constants.blur *= 1.001;
    let report = compare(&rows(&pipeline).0, &baseline).with_probe(&pipeline, &probe, true);
    let attribution = report.attribution.as_ref().unwrap();
    assert_eq!((report.verdict, attribution.first()), (DriftVerdict::Drifted, Some(Stage::Renderer)), "{report}");
    let effect = attribution.metrics.iter().find(|metric| metric.metric == "psnr").unwrap();
    let difference = report.comparisons[0].paired.as_ref().unwrap().difference;
    Tolerance::absolute(1e-9).assert([effect.effects[3]], [difference], "the renderer's effect is the whole of it");
    assert!(report.to_string().contains("The first change is in the renderer: "), "{report}");
    let json = serde_json::to_value(attribution).unwrap();
    assert_eq!(json["stages"][3]["stage"], "splatter", "as in older files");

    std::fs::write(Baseline::probe_path(&path), run(&pipeline, &inputs).unwrap().to_bytes().unwrap()).unwrap();
    assert!(matches!(baseline.read_probe(&path), Err(DriftError::Malformed(_))), "another run's values");
}
