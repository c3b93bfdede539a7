use std::collections::{BTreeMap, BTreeSet};

use atsplat_protocol::Aggregation;
use atsplat_results::TargetStatus;
use atsplat_results::statistics::{SelectedTarget, mean_of, score_of, summary_of};
use serde::{Deserialize, Serialize};

use super::{Baseline, BaselineTarget, Cause, Comparison, DriftReport, DriftVerdict, Finding, FindingKind};

/// One number of an accepted run, kept when the rows are replaced by a later acceptance.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub struct AcceptedNumber {
    /// Position in the baseline's history, from 0.
    pub acceptance: usize,
    /// Name of the preset.
    pub preset: String,
    /// Name of the method.
    pub method: String,
    /// Id of the metric.
    pub metric: String,
    /// Mean over scenes.
    pub mean: f64,
    /// Its 95 % interval; `None` with one scene.
    pub interval: Option<[f64; 2]>,
    /// How far the mean of a later run may change; `None` for a deterministic method, which is compared bit by bit.
    pub limit: Option<f64>,
    /// Verdict against the previous acceptance; `None` if that has no such number.
    pub verdict: Option<DriftVerdict>,
    /// Mean difference from the previous acceptance over the targets that both have, on which the verdict is; `None` without such
    /// targets, and in baselines of older versions.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub difference: Option<f64>,
}

/// The history of one number over all acceptances and the current run.
#[derive(Clone, Debug, PartialEq)]
pub struct NumberHistory {
    /// Name of the preset.
    pub preset: String,
    /// Name of the method.
    pub method: String,
    /// Id of the metric.
    pub metric: String,
    /// Accepted runs, oldest first, each with the mean over all of its targets; then the current run, with the mean over the targets
    /// that it is compared on, if there are any.
    pub runs: Vec<HistoricRun>,
    /// Number of acceptances without the number, or from before numbers were recorded.
    pub unknown: usize,
    /// The verdict on the current run: on this number, and on what else has changed of its preset and method.
    pub verdict: DriftVerdict,
    /// The verdict on all of the current run.
    pub of_run: DriftVerdict,
}

/// A number in one run.
#[derive(Clone, Debug, PartialEq)]
pub struct HistoricRun {
    /// The date of its acceptance, or `now`.
    pub label: String,
    /// Mean over scenes.
    pub mean: f64,
    /// The range of means that the previous baseline allowed, around the mean from which this one moved; `None` if that baseline has no
    /// such number.
    pub limits: Option<[f64; 2]>,
    /// The verdict against that baseline.
    pub verdict: Option<DriftVerdict>,
    /// Mean difference from that baseline over the targets that both have; in baselines of older versions, the difference of both means.
    pub moved: Option<f64>,
    /// Why it was accepted; for the current run, where something changed first, or what else than the number has changed. If the
    /// mean is within its limits but a scene is not, that is said first.
    pub why: Option<String>,
}

/// Those of the preset, the method and the metric.
pub(super) type Name = (String, String, String);

/// Mean and interval of every metric of every method under every preset.
fn means(targets: &[BaselineTarget]) -> BTreeMap<Name, (f64, Option<[f64; 2]>)> {
    of_each(targets, |selected| {
        let summary = summary_of(selected, Aggregation::SceneMeans);
        Some((summary.mean?, summary.interval))
    })
}

/// [`means`] without the intervals.
pub(super) fn means_of(targets: &[BaselineTarget]) -> BTreeMap<Name, f64> {
    of_each(targets, |selected| mean_of(selected, Aggregation::SceneMeans))
}

/// What `number` makes of the targets in the mean of every metric of every method under every preset.
fn of_each<T>(targets: &[BaselineTarget], number: impl Fn(&[SelectedTarget<'_>]) -> Option<T>) -> BTreeMap<Name, T> {
    let mut names: BTreeSet<(&str, &str, &str)> = BTreeSet::new();
    let mut groups: BTreeMap<(&str, &str), Vec<&BaselineTarget>> = BTreeMap::new();
    for row in targets {
        let (preset, method) = (row.key.preset.as_str(), row.key.method.as_str());
        names.extend(row.scores.keys().map(|metric| (preset, method, metric.as_str())));
        groups.entry((preset, method)).or_default().push(row);
    }
    for rows in groups.values_mut() {
        rows.sort_by(|a, b| (&a.key, a.target).cmp(&(&b.key, b.target)));
    }
    let named_number = |(preset, method, metric): (&str, &str, &str)| {
        let selected = groups.get(&(preset, method))?.iter().filter_map(|row| selected(row, metric));
        let number = number(&selected.collect::<Vec<_>>())?;
        Some(((preset.to_owned(), method.to_owned(), metric.to_owned()), number))
    };
    names.into_iter().filter_map(named_number).collect()
}

/// A target of a table's mean: scored, and not identical to the truth.
fn selected<'a>(row: &'a BaselineTarget, metric: &str) -> Option<SelectedTarget<'a>> {
    let value = score_of(row.status, row.scores.get(metric).copied(), metric)?;
    let id = (row.key.scene.as_str(), row.key.entry, row.target);
    (row.status != TargetStatus::Identical).then(|| SelectedTarget::of_score(id, value))
}

impl Baseline {
    /// With the numbers of its rows and none of earlier acceptances.
    pub(super) fn with_numbers_of_rows(self) -> Self {
        Self { numbers: numbers_of_rows(&self, None), ..self }
    }
}

/// The numbers of a baseline's rows, which belong to its last acceptance. `report` compares them with the previous one.
pub(super) fn numbers_of_rows(baseline: &Baseline, report: Option<&DriftReport>) -> Vec<AcceptedNumber> {
    let acceptance = baseline.history.len().saturating_sub(1);
    let number = |((preset, method, metric), (mean, interval)): (Name, _)| {
        let same = |name: (&String, &String, &String)| name == (&preset, &method, &metric);
        let mut limits = baseline.limits.iter();
        let limit = limits.find(|limit| same((&limit.preset, &limit.method, &limit.metric))).map(|limit| limit.limit);
        let mut comparisons = report.iter().flat_map(|report| &report.comparisons);
        let compared = comparisons.find(|number| same((&number.preset, &number.method, &number.metric)));
        let verdict = compared.map(|comparison| comparison.verdict);
        let difference = compared.and_then(|comparison| Some(comparison.paired.as_ref()?.difference));
        AcceptedNumber { acceptance, preset, method, metric, mean, interval, limit, verdict, difference }
    };
    means(&baseline.targets).into_iter().map(number).collect()
}

/// The history of every number in a report, in its order.
pub fn histories(baseline: &Baseline, report: &DriftReport) -> Vec<NumberHistory> {
    report.comparisons.iter().map(|comparison| history(baseline, comparison, report)).collect()
}

fn history(baseline: &Baseline, comparison: &Comparison, report: &DriftReport) -> NumberHistory {
    let Comparison { preset, method, metric, limit, .. } = comparison;
    let finding = drifted_finding(comparison, report);
    let verdict = if finding.is_some() { DriftVerdict::Drifted } else { comparison.verdict };
    let is_same =
        |number: &&AcceptedNumber| (&number.preset, &number.method, &number.metric) == (preset, method, metric);
    let mut runs = Vec::new();
    let mut before: Option<&AcceptedNumber> = None;
    for number in baseline.numbers.iter().filter(is_same) {
        runs.push(accepted_run(baseline, number, before));
        before = Some(number);
    }
    let unknown = baseline.history.len().saturating_sub(runs.len());
    if let (Some(was), Some(mean), Some(paired)) = (comparison.baseline, comparison.now, &comparison.paired) {
        let limits = Some(range(was, *limit));
        let cause =
            finding.map(|finding| finding.kind.description()).or_else(|| report.first_change().map(Cause::name));
        runs.push(HistoricRun {
            label: "now".to_owned(),
            mean,
            limits,
            verdict: Some(verdict),
            moved: Some(paired.difference),
            why: why(is_of_scene(Some(comparison.verdict), mean, limits), cause.map(str::to_owned)),
        });
    }
    let (preset, method, metric) = (preset.clone(), method.clone(), metric.clone());
    NumberHistory { preset, method, metric, runs, unknown, verdict, of_run: report.verdict }
}

/// A number of an acceptance after that of `before`, which may be of an acceptance before the previous one.
fn accepted_run(baseline: &Baseline, number: &AcceptedNumber, before: Option<&AcceptedNumber>) -> HistoricRun {
    let AcceptedNumber { acceptance, mean, verdict, difference, .. } = *number;
    let accepted = baseline.history.get(acceptance);
    let was_compared = |before: &&AcceptedNumber| {
        before.acceptance.checked_add(1) == Some(acceptance) && verdict != Some(DriftVerdict::Nothing)
    };
    let previous = before.filter(was_compared);
    let limits = previous.map(|previous| {
        // The acceptances may have different targets.
        let was = difference.map_or(previous.mean, |difference| mean - difference);
        range(was, previous.limit)
    });
    HistoricRun {
        label: accepted.map_or_else(|| acceptance.to_string(), |accepted| accepted.date.clone()),
        mean,
        limits,
        verdict,
        moved: previous.map(|previous| difference.unwrap_or(mean - previous.mean)),
        why: why(is_of_scene(verdict, mean, limits), accepted.map(|accepted| accepted.reason.clone())),
    }
}

/// The means that a limit allows around another one; that alone, if numbers are compared bit by bit.
fn range(mean: f64, limit: Option<f64>) -> [f64; 2] {
    limit.map_or([mean; 2], |limit| [mean - limit, mean + limit])
}

/// Whether a number drifted although its mean is within limits: then that of a scene is not.
fn is_of_scene(verdict: Option<DriftVerdict>, mean: f64, limits: Option<[f64; 2]>) -> bool {
    let is_within = |[low, high]: [f64; 2]| low < high && (low..=high).contains(&mean);
    verdict == Some(DriftVerdict::Drifted) && limits.is_some_and(is_within)
}

fn why(is_of_scene: bool, cause: Option<String>) -> Option<String> {
    let scene = is_of_scene.then(|| "at least one scene moved".to_owned());
    let parts: Vec<String> = scene.into_iter().chain(cause).collect();
    (!parts.is_empty()).then(|| parts.join(": "))
}

/// The first change other than of scores that is drift of a number's preset and method, if the number itself did not drift.
fn drifted_finding<'a>(comparison: &Comparison, report: &'a DriftReport) -> Option<&'a Finding> {
    if !report.drifted() || comparison.verdict == DriftVerdict::Drifted {
        return None;
    }
    let is_of_it = |finding: &&Finding| {
        // The lost score may be that of another metric.
        let is_of_metric = finding.kind != FindingKind::Score || comparison.verdict == DriftVerdict::Nothing;
        finding.verdict == DriftVerdict::Drifted
            && finding.preset == comparison.preset
            && (finding.method.is_empty() || finding.method == comparison.method)
            && is_of_metric
    };
    report.findings.iter().find(is_of_it)
}
