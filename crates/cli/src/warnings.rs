//! Prints counted warnings about data, and those of runs.

use std::collections::BTreeMap;

use atsplat_numeric::counted;
use atsplat_results::store::KnownResults;
use atsplat_results::{MetricRecord, Provenance, Results, TrialNote, WarningCount};
use atsplat_scene::{WarningKind, Warnings};

use crate::print::{note, print_status, warn};

/// Prints the warnings of runs, about their data and their trials, counted by protocol and kind, with the first of each.
/// Warnings in `printed` were already printed when the data were opened and sampled.
pub(crate) fn print_findings(stores: &[&Results], printed: &Warnings) {
    for ((preset, kind), (count, example)) in findings(stores, printed) {
        warn(&format!("{preset}: {count} × {kind}"));
        print_status(&format!("    {example}"));
    }
    for results in stores {
        print_trial_warnings(results);
    }
}

/// Says before a run which metrics it will not compute, because their weights are missing, and what to do: a line for each file.
pub(crate) fn print_absent_metrics(metrics: &[MetricRecord]) {
    for line in absent_metrics(metrics) {
        note(&line);
    }
}

fn absent_metrics(metrics: &[MetricRecord]) -> Vec<String> {
    let mut by_reason: BTreeMap<&str, Vec<&str>> = BTreeMap::new();
    for MetricRecord { id, absent, .. } in metrics {
        if let Some(reason) = absent {
            by_reason.entry(reason).or_default().push(id);
        }
    }
    let line = |(reason, ids): (&str, Vec<&str>)| {
        format!(
            "{} will not be computed: {reason}; once the file is there, or --metric-weights names its folder, the same command \
             evaluates these results again with it",
            ids.join(", ")
        )
    };
    by_reason.into_iter().map(line).collect()
}

/// Says before a run which of the results that it resumes it will evaluate again, because they lack a metric or failed: a line for
/// each method and reason.
pub(crate) fn print_evaluated_again(known: &KnownResults, run: &Provenance) {
    for (method, count) in known.retried(run) {
        let are = if count == 1 { "is" } else { "are" };
        note(&format!("{} of {method} {are} evaluated again", counted(count, "failed result")));
    }
    for (method, count) in known.lacking(run) {
        let deterministic = run.method(method).is_some_and(|record| record.deterministic);
        note(&evaluated_again(method, count, deterministic));
    }
}

fn evaluated_again(method: &str, count: u64, deterministic: bool) -> String {
    let (lack, are) = if count == 1 { ("lacks", "is") } else { ("lack", "are") };
    let others = if deterministic { "" } else { "; where renders are not the same again, all of their numbers change" };
    format!("{} of {method} {lack} a metric and {are} evaluated again{others}", counted(count, "result"))
}

/// Warnings about data by protocol and kind, with the first of each. Stores of one protocol's data all have them: they count
/// once. Those of which as many were printed are left out.
fn findings<'a>(stores: &[&'a Results], printed: &Warnings) -> BTreeMap<(&'a str, &'a str), (u64, &'a str)> {
    let printed: BTreeMap<String, u64> = printed.counts().map(|(kind, count)| (kind.to_string(), count)).collect();
    let all = stores.iter().copied().flat_map(|results| &results.provenance.warnings);
    let mut findings: BTreeMap<(&str, &str), (u64, &str)> = BTreeMap::new();
    for WarningCount { preset, kind, count, example } in all {
        if printed.get(kind).is_none_or(|printed| printed < count) {
            let known = findings.entry((preset, kind)).or_insert((*count, example));
            if known.0 < *count {
                *known = (*count, example);
            }
        }
    }
    findings
}

/// Prints what trials noted, as warnings, by protocol, method and kind.
pub(crate) fn print_trial_warnings(results: &Results) {
    let is_warning = |note: &&String| !matches!(TrialNote::of(note), Some(TrialNote::StepsTaken { .. }));
    let mut notes: BTreeMap<(&str, &str, &str), (u64, String)> = BTreeMap::new();
    for trial in &results.trials {
        for note in trial.notes.iter().filter(is_warning) {
            let kind = note.split_once(": ").map_or(note.as_str(), |(kind, _)| kind);
            let example = || (0, format!("{}: {note}", trial.key.scene));
            notes.entry((&trial.key.preset, &trial.key.method, kind)).or_insert_with(example).0 += 1;
        }
    }
    for ((preset, method, kind), (count, example)) in notes {
        warn(&format!("{preset}: {count} × {kind}, in trials of {method}"));
        print_status(&format!("    {example}"));
    }
}

/// Prints counted warnings on standard error, by kind, with the first few of each.
pub(crate) fn print_warnings(warnings: &Warnings) {
    warnings.counts().for_each(|(kind, count)| print_kind(warnings, kind, count));
}

/// As [`print_warnings`], without the kinds of which the report of `results` counts as many: warnings of opening and sampling data
/// that reading the trials gave again.
pub(crate) fn print_unreported(warnings: &Warnings, results: &Results) {
    unreported(warnings, results).for_each(|(kind, count)| print_kind(warnings, kind, count));
}

/// Kinds with their counts that the warnings of all protocols together do not reach.
fn unreported(warnings: &Warnings, results: &Results) -> impl Iterator<Item = (WarningKind, u64)> {
    let reported = move |kind: WarningKind| -> u64 {
        let kind = kind.to_string();
        results.provenance.warnings.iter().filter(|warning| warning.kind == kind).map(|warning| warning.count).sum()
    };
    warnings.counts().filter(move |(kind, count)| *count > reported(*kind))
}

fn print_kind(warnings: &Warnings, kind: WarningKind, count: u64) {
    const SHOWN: usize = 3;
    warn(&format!("{count} × {kind}"));
    for warning in warnings.kept().iter().filter(|warning| warning.kind == kind).take(SHOWN) {
        print_status(&format!("    {warning}"));
    }
    if count > SHOWN as u64 {
        print_status(&format!("    and {} more", count - SHOWN as u64));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn store(warnings: &[(&str, &str, u64)]) -> Results {
        let warning = |(preset, kind, count): &(&str, &str, u64)| WarningCount {
            preset: (*preset).to_owned(),
            kind: (*kind).to_owned(),
            count: *count,
            example: format!("one of {count}"),
        };
        let warnings = warnings.iter().map(warning).collect();
        Results { provenance: Provenance { warnings, ..Provenance::default() }, ..Results::default() }
    }

    #[test]
    fn metrics_without_weights_are_named_once_for_each_file() {
        let metric = |id: &str, absent: Option<&str>| MetricRecord {
            id: id.to_owned(),
            absent: absent.map(str::to_owned),
            ..MetricRecord::default()
        };
        let [vgg, alex] = ["LPIPS (VGG) needs a.pth", "LPIPS (Alex) needs b.pth"].map(Some);
        let metrics =
            [metric("psnr", None), metric("lpips", vgg), metric("lpips-alex", alex), metric("lpips-clipped", vgg)];
        let lines = absent_metrics(&metrics);
        let starts =
            ["lpips-alex will not be computed: LPIPS (Alex)", "lpips, lpips-clipped will not be computed: LPIPS (VGG)"];
        assert!(lines.len() == 2 && lines.iter().zip(starts).all(|(line, start)| line.starts_with(start)), "{lines:?}");
        assert!(lines.iter().all(|line| line.contains("--metric-weights")), "{lines:?}");
    }

    #[test]
    fn what_is_evaluated_again_is_counted() {
        assert_eq!(evaluated_again("warp", 1, true), "1 result of warp lacks a metric and is evaluated again");
        let expected = "120 results of mine lack a metric and are evaluated again; where renders are not the same again, all of \
                        their numbers change";
        assert_eq!(evaluated_again("mine", 120, false), expected);
    }

    /// Networks and their ablations are in two stores, on the same data; a few unreadable scenes were known when it was opened.
    #[test]
    fn findings_of_stores_with_the_same_data_count_once() {
        let networks = store(&[("rooms", "missing-image", 5), ("yards", "missing-image", 2)]);
        let ablations = store(&[("rooms", "missing-image", 5), ("rooms", "unreadable-scene", 3)]);
        let mut printed = Warnings::new();
        for scene in ["a", "b", "c"] {
            let found: Vec<_> = findings(&[&networks, &ablations], &printed).into_iter().collect();
            let expected = [
                (("rooms", "missing-image"), (5, "one of 5")),
                (("rooms", "unreadable-scene"), (3, "one of 3")),
                (("yards", "missing-image"), (2, "one of 2")),
            ];
            assert_eq!(found, expected, "fewer were printed than there are");
            printed.push(WarningKind::UnreadableScene, scene, "cut off");
        }
        let kinds: Vec<&str> = findings(&[&ablations], &printed).into_keys().map(|(_, kind)| kind).collect();
        assert_eq!(kinds, ["missing-image"], "all three were printed");
    }

    /// Two protocols on the same three frames: a sampler reads them for each.
    #[test]
    fn warnings_of_sampling_are_left_to_a_report_that_counts_as_many() {
        let results = store(&[("a", "missing-image", 3), ("b", "missing-image", 3), ("a", "lens-distortion", 2)]);
        let mut sampling = Warnings::new();
        let kinds = |sampling: &Warnings| unreported(sampling, &results).collect::<Vec<_>>();
        for frame in 0..6 {
            sampling.push(WarningKind::MissingImage, "s", format!("frame {frame}"));
        }
        assert!(kinds(&sampling).is_empty(), "{:?}", kinds(&sampling));
        sampling.push(WarningKind::UnreadableScene, "t", "cut off");
        assert_eq!(kinds(&sampling), [(WarningKind::UnreadableScene, 1)]);
        sampling.push(WarningKind::MissingImage, "u", "a scene without trials");
        assert_eq!(kinds(&sampling), [(WarningKind::MissingImage, 7), (WarningKind::UnreadableScene, 1)]);
    }
}
