//! Losses and gains for both directions of metrics on every basis; missing and new rows.

use super::*;

/// Per metric: a base score, and the limit of a mean without repeated runs (0.01 dB, and half the last digit that papers print
/// for the others).
const METRICS: [(&str, f64, f64); 4] =
    [("psnr", 22.0, 0.01), ("ssim", 0.8, 0.0005), ("lpips", 0.2, 0.0005), ("l1", 0.05, 0.0005)];
const BASES: [Basis; 3] = [Basis::Exact, Basis::Bound, Basis::Interval];

/// Eight scenes of three targets with equal scores.
fn constant(metric: &str, score: f64, basis: Basis) -> Results {
    let names: Vec<String> = (0..8).map(|scene| format!("scene {scene}")).collect();
    let rows: Vec<_> = names.iter().map(|name| (name.as_str(), 0, vec![score; 3])).collect();
    let mut base = results("m", metric, &rows);
    base.targets.iter_mut().for_each(|row| row.render_hash = None);
    add_method(&mut base, basis != Basis::Interval);
    base
}

/// A run whose scenes changed by `by`, against a baseline with constant scores.
fn report(metric: &str, score: f64, basis: Basis, by: impl Fn(usize) -> f64) -> DriftReport {
    let then = constant(metric, score, basis);
    let mut now = then.clone();
    for (at, row) in now.targets.iter_mut().enumerate() {
        row.scores.values_mut().for_each(|score| *score += by(at / 3));
    }
    if basis == Basis::Bound {
        now.provenance.processor = "another".to_owned();
    }
    let report = compare(&now, &baseline_of(&then));
    assert_eq!((report.comparisons.len(), report.comparisons[0].basis), (1, basis), "{report}");
    report
}

/// Without spread the interval is the difference itself: beyond the limit on either side it is drift.
#[test]
fn losses_and_gains_beyond_the_limit_are_drift_on_every_basis() {
    for (metric, score, limit) in METRICS {
        Tolerance::EXACT.assert([least_limit(metric)], [limit], metric);
        for basis in BASES {
            for by in [-1.5 * limit, 1.5 * limit] {
                let report = report(metric, score, basis, |_| by);
                let [comparison] = &report.comparisons[..] else { panic!("{report}") };
                assert_eq!(report.verdict, DriftVerdict::Drifted, "{metric} by {by} on {basis:?}: {report}");
                let higher_is_better = matches!(metric, "psnr" | "ssim");
                let better = (by > 0.0) == higher_is_better;
                assert_eq!(comparison.improved(), Some(better), "{metric} by {by}");
                let paired = comparison.paired.as_ref().unwrap();
                let expected = if better { [8, 0, 0] } else { [0, 0, 8] };
                assert_eq!([paired.wins, paired.ties, paired.losses], expected, "{metric} by {by}");
                Tolerance::absolute(1e-12).assert([paired.difference, comparison.largest], [by, by.abs()], metric);
                let words = if better { "DRIFTED, better" } else { "DRIFTED, worse" };
                assert!(report.to_string().contains(words), "{metric} by {by}: {report}");
            }
        }
    }
}

/// Half the limit: drift on the exact basis only.
#[test]
fn losses_and_gains_within_the_limit_are_drift_only_on_the_exact_basis() {
    for (metric, score, limit) in METRICS {
        for (basis, expected) in [
            (Basis::Exact, DriftVerdict::Drifted),
            (Basis::Bound, DriftVerdict::Within),
            (Basis::Interval, DriftVerdict::Within),
        ] {
            for by in [-0.5 * limit, 0.5 * limit] {
                assert_eq!(report(metric, score, basis, |_| by).verdict, expected, "{metric} by {by} on {basis:?}");
            }
            assert_eq!(report(metric, score, basis, |_| 0.0).verdict, DriftVerdict::Same, "{metric} on {basis:?}");
        }
    }
}

/// Two of eight scenes change so much that the mean, but not the whole interval, is beyond the limit: not significant, so no
/// drift. With all eight changing by slightly different amounts it is drift.
#[test]
fn an_interval_that_overlaps_the_limit_is_not_drift() {
    for (metric, score, limit) in METRICS {
        for side in [-1.0, 1.0] {
            let few = report(metric, score, Basis::Interval, |scene| if scene < 2 { 8.0 * side * limit } else { 0.0 });
            let paired = few.comparisons[0].paired.as_ref().unwrap();
            assert!(side * paired.difference > limit, "the mean alone would be drift: {paired:?}");
            assert_eq!(few.verdict, DriftVerdict::Within, "{metric} {side}: {few}");
            let text = few.to_string();
            let unsure = "(this difference is larger, but its interval is not beyond), those of a scene by ";
            assert!(text.contains(" interval within limits\n") && text.contains(unsure), "{text}");
            let all = report(metric, score, Basis::Interval, |scene| side * limit * (1.5 + 0.1 * scene as f64));
            assert_eq!(all.verdict, DriftVerdict::Drifted, "{metric} {side}: {all}");
            assert!(!all.to_string().contains("its interval is not beyond"), "{all}");
        }
    }
}

/// All targets of one scene of eight, or one of its three: the interval over scenes contains 0, and the mean is far beyond its limit.
#[test]
fn a_scene_that_is_destroyed_is_drift_whatever_the_others_do() {
    for (metric, score, _) in METRICS {
        let of_scene = scene_limit(metric, None, 8);
        for (basis, side) in [(Basis::Bound, -1.0), (Basis::Interval, 1.0)] {
            for (share, expected) in [(0.9, DriftVerdict::Within), (1.1, DriftVerdict::Drifted)] {
                let by = side * share * of_scene;
                let report = report(metric, score, basis, |scene| if scene == 5 { by } else { 0.0 });
                let [comparison] = &report.comparisons[..] else { panic!("{report}") };
                let [low, high] = comparison.paired.as_ref().unwrap().interval.unwrap();
                assert!(low <= 0.0 && high >= 0.0, "{low} {high}");
                assert_eq!(report.verdict, expected, "{metric} by {by} on {basis:?}: {report}");
                let largest = comparison.largest_scene.as_ref().unwrap();
                assert_eq!(largest.scene, "scene 5");
                Tolerance::absolute(1e-12).assert([largest.change], [by], metric);
                assert!(report.to_string().contains("; the mean of scene 5 changed by "), "{report}");
            }
        }
    }
    Tolerance::EXACT.assert(
        [scene_limit("psnr", None, 8), scene_limit("lpips", None, 8)],
        [0.5, 0.02],
        "without repeats",
    );
    let of = |metric: &str, limit: f64, runs: u64, scene: Option<f64>, scenes: u64| {
        let [preset, method, metric] = ["p", "m", metric].map(str::to_owned);
        let known = Limit { preset, method, metric, limit, origin: runs.into(), scene };
        scene_limit(&known.metric, Some(&known), scenes)
    };
    let estimated = [of("psnr", 0.5, 2, None, 16), of("psnr", 0.02, 2, None, 16), of("ssim", 0.01, 2, None, 9)];
    Tolerance::F64.assert(estimated, [4.0, 0.5, 0.06], "twice the noise of the mean times the root of the scenes");
    let quiet = [of("psnr", 0.01, 2, None, 6474), of("psnr", 0.5, 1, None, 16)];
    Tolerance::EXACT.assert(quiet, [0.5, 0.5], "neither the least limit of a mean nor one run is noise");
    let measured = [of("psnr", 0.5, 2, Some(0.7), 16), of("psnr", 0.5, 2, Some(0.1), 16)];
    Tolerance::EXACT.assert(measured, [0.7, 0.5], "what the runs showed of a scene");
}

/// A single scene has no interval, so the difference decides.
#[test]
fn a_single_scene_is_judged_by_its_difference() {
    for side in [-1.0, 1.0] {
        for (share, expected) in [(0.5, DriftVerdict::Within), (1.5, DriftVerdict::Drifted)] {
            let mut then = constant("psnr", 22.0, Basis::Interval);
            then.targets.truncate(3);
            then.trials.truncate(1);
            let mut now = then.clone();
            now.targets.iter_mut().for_each(|row| *row.scores.get_mut("psnr").unwrap() += side * share * 0.01);
            let report = compare(&now, &baseline_of(&then));
            assert!(report.comparisons[0].paired.as_ref().unwrap().interval.is_none());
            assert_eq!(report.verdict, expected, "{side} {share}: {report}");
        }
    }
}

/// The largest loss or gain, whichever is larger.
#[test]
fn the_largest_change_in_either_direction_is_named() {
    for (loss, gain, scene) in [(-0.5, 0.2, "scene 3"), (-0.2, 0.5, "scene 5")] {
        let by = |at| match at {
            3 => loss,
            5 => gain,
            _ => 0.0,
        };
        let report = report("psnr", 22.0, Basis::Exact, by);
        let [comparison] = &report.comparisons[..] else { panic!("{report}") };
        Tolerance::absolute(1e-12).assert([comparison.largest], [0.5], "largest");
        assert_eq!((comparison.changed, comparison.largest_at.as_ref().unwrap().starts_with(scene)), (6, true));
    }
}

/// A row of the worst or the best score is missing, on each basis: the other rows are compared as before.
#[test]
fn missing_rows_are_drift_and_do_not_affect_other_numbers() {
    for basis in BASES {
        for (metric, odd) in [("psnr", 5.0), ("psnr", 50.0), ("lpips", 0.01), ("lpips", 0.9)] {
            let mut then = constant(metric, if metric == "psnr" { 22.0 } else { 0.2 }, basis);
            then.targets[0].scores.values_mut().for_each(|score| *score = odd);
            let baseline = baseline_of(&then);
            let mut now = then.clone();
            now.targets.remove(0);
            if basis == Basis::Bound {
                now.provenance.processor = "another".to_owned();
            }
            let report = compare(&now, &baseline);
            assert_eq!(kinds(&report), [(FindingKind::Missing, DriftVerdict::Drifted, 1)], "{basis:?} {metric} {odd}");
            let [comparison] = &report.comparisons[..] else { panic!("{report}") };
            assert_eq!((report.verdict, comparison.verdict), (DriftVerdict::Drifted, DriftVerdict::Same), "{report}");
            assert_eq!(comparison.baseline, comparison.now, "the missing target is in neither mean");
            assert!(report.to_string().contains("targets are missing: 1, such as scene 0 0 frame 0"), "{report}");
            // A failed row has no number either.
            let mut failed = then.clone();
            failed.targets[0].status = TargetStatus::Failed;
            failed.targets[0].scores.clear();
            failed.provenance.processor.clone_from(&now.provenance.processor);
            let found = kinds(&compare(&failed, &baseline));
            let expected = [FindingKind::Status, FindingKind::Score].map(|kind| (kind, DriftVerdict::Drifted, 1));
            assert_eq!(found, expected, "{basis:?} {metric} {odd}");
        }
    }
}

/// New scenes are reported but not compared.
#[test]
fn new_rows_are_reported_and_do_not_affect_numbers() {
    for basis in BASES {
        for odd in [5.0, 50.0] {
            let then = constant("psnr", 22.0, basis);
            let mut now = then.clone();
            let more = results("m", "psnr", &[("scene 9", 0, vec![odd; 2])]);
            now.trials.extend(more.trials);
            now.targets.extend(more.targets);
            if basis == Basis::Bound {
                now.provenance.processor = "another".to_owned();
            }
            let report = compare(&now, &baseline_of(&then));
            assert_eq!(kinds(&report), [(FindingKind::New, DriftVerdict::Within, 2)], "{basis:?} {odd}");
            let [comparison] = &report.comparisons[..] else { panic!("{report}") };
            assert_eq!((report.verdict, comparison.verdict), (DriftVerdict::Within, DriftVerdict::Same), "{report}");
            Tolerance::EXACT.assert([comparison.now.unwrap()], [22.0], "the mean over what both have");
            assert_eq!(comparison.paired.as_ref().unwrap().targets, 24);
        }
    }
}
