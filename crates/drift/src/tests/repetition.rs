//! What is taken for a repetition of a run, and the limits of a scene's mean that repetitions give.

use atsplat_results::TargetRow;

use super::*;

/// Something that makes results another run than the one they repeat.
type Change = fn(&mut Results);

#[test]
fn only_finished_runs_of_the_same_plan_on_the_same_data_are_repetitions() {
    let mut run = store(false, 4, 0.5, 1);
    run.provenance.commit = Some("f00".to_owned());
    let with = |change: fn(&mut Results)| {
        let mut repeat = store(false, 4, 0.5, 2);
        repeat.provenance.presets[0].dataset = "a copy".to_owned();
        repeat.provenance.commit = Some("f00".to_owned());
        (repeat.provenance.processor, repeat.provenance.threads) = ("another".to_owned(), 7);
        change(&mut repeat);
        check_repetition(&run, &[], &repeat)
    };
    with(|_| ()).unwrap();
    with(|repeat| repeat.targets.reverse()).unwrap();
    with(|repeat| _ = repeat.provenance.methods[0].parameters.insert("folder".to_owned(), "renders-2".into())).unwrap();
    let cases: [(Change, &str); 13] = [
        (|repeat| repeat.provenance.commit = Some("bad".to_owned()), "run, found commit: bad instead of f00"),
        (|repeat| repeat.provenance.atsplat = "0.0.9".to_owned(), "run, found atsplat: 0.0.9 instead of "),
        (|repeat| repeat.provenance.platform = "an abacus".to_owned(), "run, found platform: an abacus instead of "),
        (
            |repeat| _ = repeat.provenance.methods[0].parameters.insert("step".to_owned(), "2".into()),
            "method m, step: 2 instead of none",
        ),
        (|repeat| repeat.provenance.presets[0].entries = 5, "a finished run, found a store is not done: 4 of 5"),
        (|repeat| repeat.targets.iter_mut().for_each(|row| row.scores.clear()), "expected results with scores"),
        (|repeat| repeat.provenance.presets[0].hash = "b".to_owned(), "preset sampled, hash: b instead of a"),
        (|repeat| repeat.provenance.presets[0].index_sha256 = "c".to_owned(), "sampled, index-sha256: c instead of "),
        (
            |repeat| repeat.provenance.methods[0].weights_sha256 = Some("d".to_owned()),
            "method m, weights-sha256: d instead of none",
        ),
        (|repeat| repeat.provenance.metrics.clear(), "metric psnr: absent instead of present"),
        (|repeat| drop(repeat.targets.remove(4)), "no target 1 of m on sampled, scene \"scene 001\", entry 0"),
        (|repeat| repeat.targets[11].target = 3, "found no target 2 of m on sampled, scene \"scene 003\", entry 0"),
        (
            |repeat| repeat.trials[2].data_hash = Some("e".to_owned()),
            "other images or cameras in m on sampled, scene \"scene 002\", entry 0",
        ),
    ];
    for (change, expected) in cases {
        let error = with(change).unwrap_err().to_string();
        assert!(error.contains(expected), "{expected}: {error}");
    }
    // The other way round.
    let mut part = run.clone();
    part.targets.remove(4);
    let error = check_repetition(&part, &[], &run).unwrap_err().to_string();
    assert!(error.ends_with("target 1 of m on sampled, scene \"scene 001\", entry 0, which the run lacks"), "{error}");
}

/// The least limit of the mean over many scenes is not the noise of one: twice that limit times the root of 700 is 0.53 dB.
#[test]
fn an_equal_repetition_does_not_loosen_the_limit_of_a_scene() {
    let names: Vec<String> = (0..700).map(|scene| format!("scene {scene:03}")).collect();
    let rows: Vec<_> = names.iter().map(|name| (name.as_str(), 0, vec![20.0])).collect();
    let mut run = results("m", "psnr", &rows);
    add_method(&mut run, false);
    let baseline = Baseline::new(&run, std::slice::from_ref(&run), acceptance("first"));
    for (by, expected) in
        [(-0.515, DriftVerdict::Drifted), (0.515, DriftVerdict::Drifted), (-0.485, DriftVerdict::Within)]
    {
        let mut now = run.clone();
        now.targets[7].scores.values_mut().for_each(|score| *score += by);
        let report = compare(&now, &baseline);
        assert_eq!((report.verdict, report.comparisons[0].basis), (expected, Basis::Interval), "{by}: {report}");
    }
}

/// Two runs whose scenes differ by 0.1 dB, but one by 0.4 dB.
#[test]
fn the_limit_of_a_scene_is_four_times_the_largest_difference_of_one() {
    let change = |scene: usize, by: f64, others: f64| {
        let mut run = store(false, 8, 0.0, 1);
        for (at, row) in run.targets.iter_mut().enumerate() {
            row.scores.values_mut().for_each(|score| *score += if at / 3 == scene { by } else { others });
        }
        run
    };
    let baseline = Baseline::new(&change(0, 0.0, 0.0), &[change(3, 0.4, -0.1)], acceptance("first"));
    let [limit] = &baseline.limits[..] else { panic!("{:?}", baseline.limits) };
    Tolerance::absolute(1e-9).assert(limit.scene, [1.6], "four times 0.4 dB");
    assert!(limit.to_string().ends_with("from 2 runs; the mean of a scene by 1.6 dB"), "{limit}");
    for (by, expected) in [(1.5, DriftVerdict::Within), (-1.7, DriftVerdict::Drifted), (1.7, DriftVerdict::Drifted)] {
        let report = compare(&change(5, by, 0.0), &baseline);
        assert_eq!(report.verdict, expected, "{by}: {report}");
    }
    assert_eq!(baseline_of(&change(0, 0.0, 0.0)).limits[0].scene, None, "one run");
}

/// Four scenes: stated limits apply to the mean, and to the mean of a scene at twice the root of their number.
#[test]
fn a_limit_can_be_stated() {
    let run = store(false, 4, 0.0, 1);
    let stated = |limit| baseline_of(&run).with_limit("psnr", limit).unwrap();
    let changed = |by: f64| {
        let mut now = run.clone();
        shift(&mut now, by);
        now
    };
    for (limit, by, expected) in [
        (0.05, -0.04, DriftVerdict::Within),
        (0.05, 0.04, DriftVerdict::Within),
        (0.03, -0.04, DriftVerdict::Drifted),
        (0.03, 0.04, DriftVerdict::Drifted),
    ] {
        let report = compare(&changed(by), &stated(limit));
        assert_eq!(report.verdict, expected, "{by} of {limit}: {report}");
    }
    let limit = &stated(0.05).limits[0];
    assert!(limit.to_string().ends_with("psnr may vary by 0.05 dB, as stated"), "{limit}");
    let bounds = [0.05, 0.5].map(|limit| scene_limit("psnr", stated(limit).limits.first(), 4));
    Tolerance::absolute(1e-9).assert(bounds, [0.5, 2.0], "the least, and 2 · 0.5 · √4");
    let (next, repeated) = (changed(-0.02), changed(0.01));
    let kept = stated(0.05).accept(&next, &[], acceptance("second"));
    assert_eq!(kept.limits, stated(0.05).limits, "as stated before");
    let replaced = stated(0.05).accept(&next, std::slice::from_ref(&repeated), acceptance("second"));
    assert_eq!(replaced.limits[0].origin, LimitOrigin::Estimated(2), "repeated runs show another");
    for limit in [0.0, -0.05, f64::NAN, f64::INFINITY] {
        let error = baseline_of(&run).with_limit("psnr", limit).unwrap_err().to_string();
        assert!(error.starts_with("limit: expected a positive change of psnr, found "), "{error}");
    }
    let unknown = baseline_of(&run).with_limit("ssim", 0.1).unwrap_err().to_string();
    assert!(unknown.contains("one of psnr") && unknown.contains("ssim"), "{unknown}");
    let exact = baseline_of(&store(true, 4, 0.0, 1)).with_limit("psnr", 0.1).unwrap_err();
    assert!(exact.to_string().contains("not deterministic"), "{exact}");
}

/// Each acceptance has the limit that held for what was compared with it.
#[test]
fn the_history_has_the_limits_that_were_stated() {
    let run = store(false, 4, 0.0, 1);
    let first = baseline_of(&run).with_limit("psnr", 0.05).unwrap();
    let second = first.accept(&run, &[], acceptance("second")).with_limit("psnr", 0.5).unwrap();
    let limits: Vec<_> = second.numbers.iter().map(|number| number.limit).collect();
    assert_eq!(limits, [Some(0.05), Some(0.5)]);
}

/// A limit from three runs, then none, then one from two others.
#[test]
fn limits_of_repeated_runs_stay_until_others_are_repeated() {
    let run = |seed| store(false, 6, 0.5, seed);
    let first = Baseline::new(&run(1), &[run(2), run(3)], acceptance("first"));
    let next = first.accept(&run(4), &[], acceptance("second"));
    assert_eq!(next.limits, first.limits);
    let said = |baseline: Baseline, repeats: &[Results]| {
        let path = std::path::Path::new("b.json");
        AcceptanceReport::new(path, baseline, acceptance("second"), &run(4), repeats, None).to_string()
    };
    let kept = said(next.clone(), &[]);
    assert!(
        kept.contains(", from 3 runs; the mean of a scene by ") && kept.contains("; kept from an earlier"),
        "{kept}"
    );
    let repeats = [run(5)];
    let others = said(next.accept(&run(4), &repeats, acceptance("third")), &repeats);
    assert!(others.contains(", from 2 runs; ") && !others.contains("; kept from"), "{others}");
    let exact = next.accept(&store(true, 6, 0.0, 1), &[], acceptance("fourth"));
    assert!(exact.limits.is_empty(), "a deterministic method has none");
}

/// The rows of `m` after a change, and those of another method, `n`, without it.
fn with_other_method(mut results: Results, change: fn(&mut Results)) -> Results {
    let other = results.clone();
    change(&mut results);
    add_rows(&mut results, other, "n");
    results.provenance.methods.push(MethodRecord { name: "n".to_owned(), ..MethodRecord::default() });
    results
}

fn fail(row: &mut TargetRow) {
    row.status = TargetStatus::Failed;
    row.scores.clear();
}

/// A method failed everywhere in the second run, and at three of twelve targets in the third.
#[test]
fn repetitions_without_scores_are_refused_or_named() {
    let run = |seed, change: fn(&mut Results)| with_other_method(store(false, 4, 0.5, seed), change);
    let first = run(1, |_| ());
    let without = run(2, |results| results.targets.iter_mut().for_each(fail));
    let error = check_repetition(&first, &[], &without).unwrap_err().to_string();
    let expected = "found no psnr of m under sampled for any target with one in the run";
    assert!(error.ends_with(expected), "{error}");
    let origins = |repeats: &[Results]| {
        let limits = Baseline::new(&first, repeats, acceptance("first")).limits;
        limits.into_iter().map(|limit| (limit.method, limit.origin)).collect::<Vec<_>>()
    };
    let of = |m, n| [("m".to_owned(), m), ("n".to_owned(), n)];
    assert_eq!(origins(&[without]), of(LimitOrigin::Least, LimitOrigin::Estimated(2)), "no limit was stated");

    let lacking = run(3, |results| results.targets[3..6].iter_mut().for_each(fail));
    let repeats = [run(2, |_| ()), lacking];
    check_repetition(&first, &repeats[..1], &repeats[1]).unwrap();
    assert_eq!(origins(&repeats), of(LimitOrigin::Estimated(3), LimitOrigin::Estimated(3)));
    let said = summary(&first, &repeats);
    let expected = "warning: repetition 2 has no psnr for 3 of 12 targets of m under sampled, such as target 0 of scene scene \
                    001, entry 0: the limit is from the others\n";
    assert!(said.contains(expected) && said.matches("repetition").count() == 1, "{said}");
    let calm = summary(&first, &repeats[..1]);
    assert!(!calm.contains("repetition"), "{calm}");
}

#[test]
fn a_copy_of_a_run_is_no_repetition_of_it() {
    let run = |seed| store(false, 4, 0.5, seed);
    let (first, second) = (run(1), run(2));
    let error =
        |earlier: &[Results], repeat: &Results| check_repetition(&first, earlier, repeat).unwrap_err().to_string();
    let of_run = error(&[], &first.clone());
    assert!(
        of_run.ends_with("expected a repetition of the run, found a copy of it: the same start and scores"),
        "{of_run}"
    );
    let twice = error(std::slice::from_ref(&second), &second);
    assert!(twice.ends_with("found a copy of another repetition: the same start and scores"), "{twice}");
    check_repetition(&first, &[run(3)], &second).unwrap();
    let mut later = first.clone();
    later.provenance.started += 60;
    check_repetition(&first, &[], &later).unwrap();
}

/// In files, the origin of a limit is a number of runs, as in older versions.
#[test]
fn the_origin_of_a_limit_is_stored_as_a_number_of_runs() {
    for (origin, runs) in [(LimitOrigin::Stated, 0), (LimitOrigin::Least, 1), (LimitOrigin::Estimated(4), 4)] {
        let [preset, method, metric] = ["p", "m", "psnr"].map(str::to_owned);
        let limit = Limit { preset, method, metric, limit: 0.05, origin, scene: None };
        let json = serde_json::to_value(&limit).unwrap();
        assert_eq!(json["runs"], runs);
        assert_eq!(serde_json::from_value::<Limit>(json).unwrap(), limit);
    }
}
