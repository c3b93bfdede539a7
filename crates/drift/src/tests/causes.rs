//! Changes that no method causes: renders that become identical to the truth, and metrics with other weights.

use super::*;

#[test]
fn means_are_those_of_tables_where_renders_are_identical_to_the_truth() {
    let mut base = store(true, 12, 0.0, 1);
    let baseline = baseline_of(&base);
    for row in &mut base.targets[..2] {
        (row.status, row.scores) = (TargetStatus::Identical, std::collections::BTreeMap::new());
    }
    let (leaked, identical) =
        (atsplat_results::statistics::Leaked::Included, atsplat_results::statistics::Identical::Excluded);
    let query =
        atsplat_results::statistics::MetricQuery { preset: PRESET, method: "m", metric: "psnr", leaked, identical };
    let table = atsplat_results::statistics::summary(&base, &query, atsplat_protocol::Aggregation::SceneMeans).mean;
    let report = compare(&base, &baseline);
    let [comparison] = &report.comparisons[..] else { panic!("{report}") };
    assert_eq!(comparison.now, table);
    assert_eq!(comparison.baseline, table, "over the same targets, which did not change");
    let paired = comparison.paired.as_ref().unwrap();
    Tolerance::EXACT.assert([paired.difference, comparison.largest], [0.0; 2], "the cap of PSNR moves nothing");
    assert_eq!((comparison.identical, paired.targets, comparison.changed), (2, 34, 0), "{report}");
    assert!(report.to_string().contains("    2 targets are left out: identical to the truth, "), "{report}");
    assert_eq!((report.verdict, comparison.verdict), (DriftVerdict::Drifted, DriftVerdict::Same), "{report}");
    assert_eq!(kinds(&report)[0], (FindingKind::Status, DriftVerdict::Drifted, 2));
    let accepted = Baseline::new(&base, &[], acceptance("second"));
    assert_eq!(accepted.numbers.iter().map(|number| Some(number.mean)).collect::<Vec<_>>(), [table]);
    assert_eq!(compare(&base, &accepted).verdict, DriftVerdict::Same);
    // The other way round, with a loss elsewhere that the cap of PSNR must not hide.
    let mut worse = store(true, 12, 0.0, 1);
    worse.targets[30].scores.values_mut().for_each(|score| *score -= 1.5);
    let report = compare(&worse, &accepted);
    let [comparison] = &report.comparisons[..] else { panic!("{report}") };
    let [then, now] = [comparison.baseline, comparison.now].map(Option::unwrap);
    assert!(now < then && comparison.improved() == Some(false), "{report}");
    Tolerance::absolute(1e-9).assert([comparison.paired.as_ref().unwrap().difference], [now - then], "one difference");
    let largest = comparison.largest_scene.as_ref().map(|scene| scene.scene.as_str());
    assert_eq!((comparison.identical, largest), (2, Some("scene 010")), "{report}");
}

/// Nothing but copies of the truth, as a method's best or worst day may be.
#[test]
fn renders_that_are_all_identical_to_the_truth_stay_the_same() {
    let mut base = store(true, 12, 0.0, 1);
    for row in &mut base.targets {
        (row.status, row.scores) = (TargetStatus::Identical, [("ssim".to_owned(), 1.0)].into());
    }
    let report = compare(&base, &baseline_of(&base));
    assert_eq!((report.verdict, report.comparisons[0].identical), (DriftVerdict::Same, 36), "{report}");
}

/// LPIPS's weights are others, and only its numbers moved: neither the method nor a stage is to blame.
#[test]
fn a_metric_with_other_weights_is_named_as_the_cause() {
    let with = |hash: &str, by: f64, psnr: f64| {
        let mut run = store(true, 12, 0.0, 1);
        for row in &mut run.targets {
            row.scores.values_mut().for_each(|score| *score += psnr);
            row.scores.insert("lpips".to_owned(), 0.2 + by);
        }
        let record =
            MetricRecord { id: "lpips".to_owned(), weights_sha256: Some(hash.to_owned()), ..MetricRecord::default() };
        run.provenance.metrics.push(record);
        run
    };
    let baseline = baseline_of(&with("a", 0.0, 0.0));
    let unchanged = probe::Attribution { stages: Vec::new(), metrics: Vec::new() };
    let said = |run: &Results| compare(run, &baseline).with_attribution(unchanged.clone()).to_string();
    let (cause, elsewhere) = ("the weights file of lpips is not the baseline's", "the method's files");
    let weights = said(&with("b", 0.03, 0.0));
    assert!(weights.contains(cause) && !weights.contains(elsewhere), "{weights}");
    let both = said(&with("b", 0.03, -1.0));
    assert!(both.contains(cause) && both.contains(elsewhere), "the weights of LPIPS do not move PSNR: {both}");
    let method = said(&with("a", 0.03, 0.0));
    assert!(!method.contains(cause) && method.contains(elsewhere), "{method}");
    let unmoved = said(&with("b", 0.0, -1.0));
    assert!(!unmoved.contains(cause) && unmoved.contains(elsewhere), "{unmoved}");
}

/// The second has the published weights.
#[test]
fn an_acceptance_names_metrics_whose_weights_are_not_the_published_ones() {
    let text = |lpips: &str| {
        let mut base = store(true, 2, 0.0, 1);
        let published = atsplat_metrics::learned::LpipsNetwork::StLpipsAlex.sha256_prefix();
        let hashes = [("lpips", lpips), ("st-lpips", published), ("psnr", "c0")];
        let metrics = hashes.map(|(id, hash)| MetricRecord {
            id: id.to_owned(),
            weights_sha256: Some(hash.to_owned()),
            ..MetricRecord::default()
        });
        base.provenance.metrics = metrics.to_vec();
        summary(&base, &[])
    };
    let warning = "warning: the weights of a learned metric are not the published ones: ";
    let found = text("a0");
    let line = format!("{warning}lpips: expected weights of SHA-256 397923af…, found a0\n");
    assert!(found.contains(&line) && found.matches(warning).count() == 1, "{found}");
    assert!(!text("397923af00").contains(warning));
}

/// Two runs that are a whole decibel apart.
#[test]
fn an_acceptance_warns_of_limits_that_hide_changes() {
    let run = |by: f64| {
        let mut base = store(false, 6, 0.0, 1);
        shift(&mut base, by);
        base
    };
    let text = |by: f64| summary(&run(0.0), &[run(by)]);
    let wide = text(1.0);
    let limits = "psnr may vary by 4 dB, from 2 runs; the mean of a scene by 4 dB\n";
    let warning = "warning: its mean may vary by 400 times the least limit: ";
    assert!(wide.contains(&format!("{limits}{warning}")), "{wide}");
    let narrow = text(0.02);
    let least = "may vary by 0.08 dB, from 2 runs; the mean of a scene by 0.5 dB\n";
    assert!(narrow.contains(least) && !narrow.contains("warning"), "{narrow}");
}

/// A target that one of the repeated runs renders as the truth must not widen the limit by the cap of PSNR.
#[test]
fn limits_leave_out_renders_that_are_identical_to_the_truth() {
    let mut repeat = store(false, 6, 0.0, 1);
    (repeat.targets[4].status, repeat.targets[4].scores) = (TargetStatus::Identical, [].into());
    let baseline = Baseline::new(&store(false, 6, 0.0, 1), &[repeat], acceptance("first"));
    let [limit] = &baseline.limits[..] else { panic!("{:?}", baseline.limits) };
    assert_eq!(limit.origin, LimitOrigin::Estimated(2));
    Tolerance::EXACT.assert([limit.limit], [least_limit("psnr")], "the other targets are the same");
}
