//! Why a setting has no mean score.

use crate::statistics::{Leaked, MetricQuery, Summary};
use crate::{Results, TargetRow, TargetStatus};

/// Why none of a method's targets has a score: for each cause the number of targets, and what the first of them says.
pub(super) fn why_unscored(results: &Results, query: &MetricQuery<'_>, summary: &Summary) -> String {
    let MetricQuery { preset, method, metric, leaked, identical: _ } = *query;
    let unsupported = results.unsupported_keys();
    let is_kept = |row: &&TargetRow| leaked == Leaked::Included || !row.leaked;
    let targets: Vec<&TargetRow> = results.targets_of(preset, method).filter(is_kept).collect();
    let first = |status: TargetStatus, is_supported: bool| {
        let has_status = |row: &&&TargetRow| row.status == status && is_supported != unsupported.contains(&row.key);
        let detail = targets.iter().filter(has_status).find_map(|row| row.detail.clone())?;
        Some(detail.strip_prefix("not applicable: ").map_or_else(|| detail.clone(), str::to_owned))
    };
    let not_computed = summary.not_computed.clone();
    let causes = [
        (summary.not_applicable, "not supported", first(TargetStatus::Failed, false)),
        (summary.failed, "failed", first(TargetStatus::Failed, true)),
        (summary.non_finite, "not finite", first(TargetStatus::NonFinite, true)),
        (summary.uncomputed, "not computed", not_computed),
        (summary.identical, "identical to the truth", None),
    ];
    let cause = |(count, what, first): (u64, &str, Option<String>)| {
        let targets = if count == 1 { "target" } else { "targets" };
        let first = first.map_or_else(String::new, |first| format!(", the first with: {first}"));
        (count > 0).then(|| format!("{count} {targets} {what}{first}"))
    };
    let causes: Vec<String> = causes.into_iter().filter_map(cause).collect();
    if !causes.is_empty() {
        return causes.join("; ");
    }
    let all = if leaked == Leaked::Excluded { " that is not a context view" } else { "" };
    format!("no target{all} has a row of {metric}")
}

#[cfg(test)]
mod tests {
    use atsplat_protocol::Preset;

    use crate::sample_rows::{PRESET, results};
    use crate::statistics::Leaked;
    use crate::tradeoff::{TradeoffReport, tradeoffs};
    use crate::{MethodRecord, PresetRecord, Results, TargetRow, TargetStatus, TrialStatus};

    /// One method that supports no trial, one that fails in both, one with samples that are NaN, and `whole`, if it is one of them.
    fn store(names: &[&str]) -> Results {
        let mut store = Results::default();
        for name in names {
            let rows = results(name, "psnr", &[("x", 0, vec![30.0, 32.0]), ("y", 0, vec![20.0])]);
            let (status, of_trial) = match *name {
                "small" => (TargetStatus::Failed, TrialStatus::NotApplicable),
                "broken" => (TargetStatus::Failed, TrialStatus::Failed),
                "nan" => (TargetStatus::NonFinite, TrialStatus::Done),
                _ => (TargetStatus::Scored, TrialStatus::Done),
            };
            store.trials.extend(rows.trials.into_iter().map(|mut row| {
                row.status = of_trial;
                row
            }));
            store.targets.extend(rows.targets.into_iter().map(|row| {
                let detail = (status != TargetStatus::Scored).then(|| format!("{name} in {}", row.key.scene));
                let scores = if detail.is_some() { [].into() } else { row.scores };
                TargetRow { status, detail, scores, ..row }
            }));
            store.provenance.methods.push(MethodRecord { name: (*name).to_owned(), ..MethodRecord::default() });
            store.provenance.metrics = rows.provenance.metrics;
        }
        let toml = Preset::named("re10k-2v-256").unwrap().to_toml().unwrap();
        store.provenance.presets.push(PresetRecord { name: PRESET.to_owned(), toml, ..PresetRecord::default() });
        store
    }

    fn report(store: &Results, metrics: &[&str], leaked: Leaked) -> TradeoffReport {
        TradeoffReport { tradeoffs: tradeoffs(store, metrics, leaked).unwrap(), unfinished: Vec::new() }
    }

    #[test]
    fn settings_without_a_score_name_the_first_reason() {
        let unscored = |found: &TradeoffReport, at: usize| {
            let reasons = found.tradeoffs[at].unscored.iter();
            reasons.map(|(label, why)| format!("{label}: {why}")).collect::<Vec<_>>()
        };
        let found = report(&store(&["small", "broken", "nan", "whole"]), &["psnr", "lpips"], Leaked::Included);
        let expected = [
            "small: 3 targets not supported, the first with: small in x",
            "broken: 3 targets failed, the first with: broken in x",
            "nan: 3 targets not finite, the first with: nan in x",
        ];
        assert_eq!(unscored(&found, 0), expected);
        let absent = "whole: 3 targets not computed, the first with: not among the metrics of this run";
        assert_eq!(unscored(&found, 1), [&expected[..], &[absent]].concat());
        let text = found.to_string();
        for line in expected {
            let (label, why) = line.split_once(": ").unwrap();
            let line = format!("- {label:<40} skipped: nothing was scored: {why}\n");
            assert_eq!(text.matches(&line).count(), 4, "both axes of both metrics: {line}: {text}");
        }
        let json = serde_json::to_value(&found).unwrap();
        let left_out = &json["tradeoffs"][0]["frontiers"][0]["left-out"];
        assert_eq!(left_out[0][1], "nothing was scored: 3 targets not supported, the first with: small in x");
    }

    #[test]
    fn a_report_in_which_no_setting_has_a_cost_says_why() {
        let mut given = store(&["small", "whole"]);
        given.provenance.schema_version = crate::store::SCHEMA_VERSION;
        let why = |store: &Results| report(store, &["psnr"], Leaked::Included).why_empty();
        assert_eq!(why(&given), None, "it has Gaussians, though no times");
        for row in &mut given.trials {
            row.gaussians = None;
        }
        let expected = "no setting has a cost; against seconds, whole: no timing pass was made: `atsplat run --timing` makes one; \
                        against Gaussians, whole: no Gaussians";
        assert_eq!(why(&given).as_deref(), Some(expected));
        assert_eq!(why(&store(&["small"])), None, "nothing was scored, which is said instead");
        assert_eq!(why(&store(&[])), None, "nor here");
    }

    #[test]
    fn a_report_without_any_score_says_so() {
        let nothing =
            |names: &[&str], metrics: &[&str], leaked| report(&store(names), metrics, leaked).nothing_scored();
        assert_eq!(nothing(&["small", "whole"], &["psnr", "lpips"], Leaked::Included), None);
        let unsupported = "sampled, psnr, small: 3 targets not supported, the first with: small in x";
        assert_eq!(nothing(&["small"], &["psnr"], Leaked::Included).as_deref(), Some(unsupported));
        let absent = "sampled, lpips, whole: 3 targets not computed, the first with: not among the metrics of this run";
        assert_eq!(nothing(&["whole"], &["lpips"], Leaked::Included).as_deref(), Some(absent));
        assert_eq!(nothing(&[], &["psnr"], Leaked::Included).as_deref(), Some("no method has a trial"));
        let mut given = store(&["whole"]);
        for row in &mut given.targets {
            row.leaked = true;
        }
        let excluded = report(&given, &["psnr"], Leaked::Excluded).nothing_scored();
        assert_eq!(
            excluded.as_deref(),
            Some("sampled, psnr, whole: no target that is not a context view has a row of psnr")
        );
    }
}
