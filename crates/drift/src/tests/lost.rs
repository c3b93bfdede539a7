//! What explains nothing, and what has no number to move: renders, methods, metrics and parts of a run that are lost.

use atsplat_results::SkippedEntry;

use super::*;

/// Compares, with a probe of which no stage changed.
fn report(then: &Results, now: &Results) -> DriftReport {
    compare(now, &baseline_of(then)).with_attribution(data::probed(&[]))
}

fn found(report: &DriftReport) -> Vec<(Cause, &str)> {
    report.changes.iter().map(|change| (change.stage, change.detail.as_str())).collect()
}

/// A network whose scores moved by an amount.
fn network(weights: &str, model: &str, prose: &str, layers: u32, by: f64) -> Results {
    let mut run = moved(by);
    let configuration = serde_json::json!({ "inferred": [prose], "layers": layers, "name": model, "title": prose });
    let record = &mut run.provenance.methods[0];
    record.weights_sha256 = Some(weights.to_owned());
    record.parameters = [
        ("background".to_owned(), layers.into()),
        ("configuration".to_owned(), configuration),
        ("model".to_owned(), model.into()),
    ]
    .into();
    run
}

#[test]
fn weights_are_named_before_settings_and_prose_not_at_all() {
    let then = network("a", "rooms", "of rooms", 6, 0.0);
    let cases = [
        (network("b", "yards", "of yards", 7, -1.0), "method m, weights-sha256: was a, is now b, and 3 more"),
        (network("a", "yards", "of yards", 7, -1.0), "method m, model: was rooms, is now yards, and 2 more"),
        (network("a", "rooms", "of yards", 7, -1.0), "method m, configuration.layers: was 6, is now 7, and 1 more"),
    ];
    for (now, detail) in cases {
        let report = report(&then, &now);
        assert_eq!(found(&report), [(Cause::Method, detail)], "{report}");
    }
    let reworded = report(&then, &network("a", "rooms", "of yards", 6, -1.0));
    assert!(reworded.differences.is_empty(), "{reworded}");
    let [(Cause::Outside, detail)] = &found(&reworded)[..] else { panic!("{reworded}") };
    assert!(detail.ends_with(": the method's files, such as renders or weights, or its code"), "{detail}");
}

/// Older versions recorded none for `run`.
#[test]
fn a_network_for_large_images_that_one_run_lacks_is_one_difference() {
    let with = |step: Option<u32>| {
        let mut run = network("a", "rooms", "of rooms", 6, 0.0);
        if let Some(step) = step {
            let large = serde_json::json!({ "coarse": { "patch-size": 16, "step": step }, "name": "rooms" });
            run.provenance.methods[0].parameters.insert("high-resolution".to_owned(), large);
        }
        run
    };
    let fields = |then: &Results, now: &Results| -> Vec<_> {
        let differences = report(then, now).differences.into_iter();
        differences.map(|found| (found.field.unwrap(), found.baseline, found.now)).collect()
    };
    let some = |text: &str| Some(text.to_owned());
    let single = |then, now| [("high-resolution".to_owned(), then, now)];
    assert_eq!(fields(&with(None), &with(Some(2))), single(None, some("present")));
    assert_eq!(fields(&with(Some(2)), &with(None)), single(some("present"), None));
    let step = [("high-resolution.coarse.step".to_owned(), some("2"), some("4"))];
    assert_eq!(fields(&with(Some(2)), &with(Some(4))), step);
}

/// As a target whose render is not there.
fn lose(results: &mut Results, target: usize) {
    let row = &mut results.targets[target];
    (row.status, row.render_hash) = (TargetStatus::Failed, None);
    row.detail = Some(format!("no file for frame {}\nbelow renders", row.frame));
    row.scores.clear();
}

#[test]
fn a_lost_render_and_one_that_is_the_truth_have_a_cause() {
    let then = store(true, 4, 0.0, 1);
    let mut lost = then.clone();
    lose(&mut lost, 7);
    let of_status = "; sampled, m: targets have another status: 1, such as scene 002 0 frame 1: was scored, is now ";
    let report_of_lost = report(&then, &lost);
    let [(Cause::Outside, detail)] = &found(&report_of_lost)[..] else { panic!("{report_of_lost}") };
    assert!(detail.ends_with(&format!("{of_status}failed: no file for frame 1")), "{detail}");
    let said = "no stage of the probe changed. The cause is outside atsplat's pipeline: the method's files, ";
    assert!(report_of_lost.to_string().contains(said), "{report_of_lost}");
    assert!(compare(&lost, &baseline_of(&then)).changes.is_empty(), "without a probe");

    let mut identical = then.clone();
    (identical.targets[7].status, identical.targets[7].scores) = (TargetStatus::Identical, [].into());
    let report = report(&then, &identical);
    let [(Cause::Outside, detail)] = &found(&report)[..] else { panic!("{report}") };
    assert!(detail.ends_with(&format!("{of_status}identical")), "{detail}");
}

/// Of four scenes with three targets each.
#[test]
fn targets_are_lost_if_they_failed_or_were_requested_and_are_not_there() {
    let then = store(true, 4, 0.0, 1);
    let baseline = baseline_of(&then);
    let mut failed = then.clone();
    lose(&mut failed, 7);
    let of = format!("m on {PRESET}, scene \"scene 002\", entry 0, frame ");
    assert_eq!(baseline.lost_targets(&failed), [format!("{of}1: no file for frame 1\nbelow renders")]);
    let mut gone = then.clone();
    gone.trials.retain(|row| row.key.scene != "scene 002");
    gone.targets.retain(|row| row.key.scene != "scene 002");
    let reasons = |reason: &str| (0..3).map(|frame| format!("{of}{frame}: {reason}")).collect::<Vec<_>>();
    assert_eq!(baseline.lost_targets(&gone), reasons("the scene was not evaluated"));
    let skipped = SkippedEntry {
        preset: PRESET.to_owned(),
        scene: "scene 002".to_owned(),
        reason: "missing-frame".to_owned(),
        detail: "frame 7".to_owned(),
        ..SkippedEntry::default()
    };
    let mut skips = gone.clone();
    skips.provenance.skipped.push(skipped);
    assert_eq!(baseline.lost_targets(&skips), reasons("skipped, missing-frame: frame 7"));
    // Nothing is lost that nobody asked for.
    let mut limited = gone.clone();
    limited.provenance.limit = Some(3);
    gone.provenance.methods[0].name = "n".to_owned();
    for other in [&then, &limited, &gone] {
        assert!(baseline.lost_targets(other).is_empty());
    }
}

/// The methods `m` and `n`, of four scenes each.
fn two() -> Results {
    let mut both = store(true, 4, 0.0, 1);
    let other = both.clone();
    add_rows(&mut both, other, "n");
    let method = MethodRecord { name: "n".to_owned(), deterministic: true, ..MethodRecord::default() };
    both.provenance.methods.push(method);
    both
}

/// The method `m` of [`two`] alone.
fn one() -> Results {
    let mut one = two();
    one.provenance.methods.truncate(1);
    one.trials.retain(|row| row.key.method == "m");
    one.targets.retain(|row| row.key.method == "m");
    one
}

#[test]
fn a_method_that_was_not_run_and_other_weights_explain_that_method_alone() {
    let then = two();
    let absent = report(&then, &one());
    assert_eq!(found(&absent), [(Cause::Method, "method n: was present, is now absent")], "{absent}");
    let trained = |results: &mut Results| {
        results.provenance.methods[1].weights_sha256 = Some("b".to_owned());
        results.targets[20].scores.values_mut().for_each(|score| *score -= 1.0);
    };
    let mut other = two();
    trained(&mut other);
    let weights = "method n, weights-sha256: was nothing, is now b";
    assert_eq!(found(&report(&then, &other)), [(Cause::Method, weights)]);
    lose(&mut other, 4);
    let both = report(&then, &other);
    let [(Cause::Method, first), (Cause::Outside, second)] = &found(&both)[..] else { panic!("{both}") };
    assert!(*first == weights && second.contains("; sampled, m: targets have another status: 1, "), "{both}");
    assert!(both.to_string().contains(". What else moved is outside atsplat's pipeline: "), "{both}");
}

/// Two of six scenes, as with a limit.
#[test]
fn a_part_of_the_targets_is_not_blamed_on_the_method() {
    let then = store(true, 6, 0.0, 1);
    let mut part = then.clone();
    part.trials.truncate(2);
    part.targets.truncate(6);
    let limited = report(&then, &part);
    let [(Cause::Outside, detail)] = &found(&limited)[..] else { panic!("{limited}") };
    assert!(
        detail.starts_with("outside atsplat's pipeline: a part of the targets was run, as with a limit"),
        "{detail}"
    );
    assert!(detail.ends_with("; sampled, m: targets are missing: 12, such as scene 002 0 frame 0"), "{detail}");
    part.targets[4].scores.values_mut().for_each(|score| *score += 1.0);
    let moved = report(&then, &part);
    let [(Cause::Outside, detail)] = &found(&moved)[..] else { panic!("{moved}") };
    assert!(detail.ends_with(": the method's files, such as renders or weights, or its code"), "{detail}");
    // Another run says nothing about this one.
    keys(&mut part).for_each(|key| key.preset = "other".to_owned());
    part.provenance.presets[0].name = "other".to_owned();
    let nothing = report(&then, &part);
    assert_eq!((nothing.verdict, nothing.changes.len()), (DriftVerdict::Nothing, 0), "{nothing}");
}

#[test]
fn a_metric_that_is_not_computed_any_more_is_named() {
    let mut then = store(true, 4, 0.0, 1);
    then.targets.iter_mut().for_each(|row| _ = row.scores.insert("lpips".to_owned(), 0.2));
    then.provenance.metrics.push(MetricRecord { id: "lpips".to_owned(), ..MetricRecord::default() });
    let mut now = then.clone();
    now.targets.iter_mut().for_each(|row| _ = row.scores.remove("lpips"));
    now.provenance.metrics[1].absent = Some("no weights".to_owned());
    let absent = report(&then, &now);
    let [(Cause::Metric, detail)] = &found(&absent)[..] else { panic!("{absent}") };
    assert!(detail.starts_with("metric lpips, absent: was nothing, is now "), "{detail}");
    now.provenance.metrics.truncate(1);
    let dropped = report(&then, &now);
    assert_eq!(found(&dropped), [(Cause::Metric, "metric lpips: was present, is now absent")], "{dropped}");
    let mut once = then.clone();
    once.targets[5].scores.remove("lpips");
    let once = report(&then, &once);
    let [(Cause::Outside, detail)] = &found(&once)[..] else { panic!("{once}") };
    assert!(detail.ends_with("scores are no longer computed: 1, such as scene 001 0 frame 2: lpips"), "{detail}");
}

#[test]
fn the_history_of_a_number_shows_what_its_method_lost() {
    let histories_of = |then: &Results, now: &Results| {
        let baseline = baseline_of(then);
        histories(&baseline, &compare(now, &baseline))
    };
    let mut now = two();
    lose(&mut now, 20);
    let found = histories_of(&two(), &now);
    let verdicts: Vec<_> = found.iter().map(|number| (number.method.as_str(), number.verdict, number.of_run)).collect();
    let drifted = DriftVerdict::Drifted;
    assert_eq!(verdicts, [("m", DriftVerdict::Same, drifted), ("n", drifted, drifted)]);
    let runs: Vec<_> = found.iter().map(|number| (number.runs[1].verdict, number.runs[1].why.as_deref())).collect();
    let expected = [(Some(DriftVerdict::Same), None), (Some(drifted), Some("targets have another status"))];
    assert_eq!(runs, expected);
    let gone = histories_of(&two(), &one());
    assert_eq!((gone[1].verdict, gone[1].runs.len()), (drifted, 1), "it has no current run");
    let nothing = histories_of(&two(), &Results::default());
    assert_eq!((nothing[0].verdict, nothing[0].of_run), (DriftVerdict::Nothing, DriftVerdict::Nothing));
}
