use std::collections::BTreeSet;
use std::fmt;
use std::path::{Path, PathBuf};

use atsplat_numeric::counted;
use atsplat_results::{GapKind, MetricRecord, Provenance, Results, TargetStatus, TrialKey, TrialStatus};
use serde::{Deserialize, Serialize};

use super::probe::Recipe;
use super::repetition::lacking_scores;
use super::{Baseline, BaselineTarget, DriftError, DriftReport, DriftVerdict, Finding, FindingKind, Limit};

/// Why a run was accepted as the baseline.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub struct Acceptance {
    /// Date in UTC, such as `2026-02-28`.
    pub date: String,
    /// Why this run's numbers are correct.
    pub reason: String,
    /// Version of atsplat that computed them.
    pub atsplat: String,
    /// Commit that it was built from, if known.
    pub commit: Option<String>,
}

/// Checks that results can become a baseline.
///
/// # Errors
/// [`DriftError::Unacceptable`] for results without scores, which cannot detect drift, and for an unfinished run.
pub fn acceptable(results: &Results) -> Result<(), DriftError> {
    let unacceptable = |expected, found| Err(DriftError::Unacceptable { expected, found });
    if results.targets.iter().all(|row| row.scores.is_empty()) {
        let targets = counted(results.targets.len() as u64, "target");
        let found = format!("{targets} without scores; an empty baseline cannot detect drift");
        return unacceptable("results with scores", found);
    }
    match results.cut_off().first() {
        Some(run) => unacceptable("a finished run", format!("{run}; the command that started it resumes it")),
        None => Ok(()),
    }
}

/// What an old baseline guards, and the results that were compared with it do not: targets without a row, and scores that are no
/// longer computed. A line for each protocol, method and kind, with a count and the first case.
fn no_longer_guarded(report: &DriftReport) -> Vec<String> {
    let line = |finding: &Finding| {
        let by = match finding.kind {
            FindingKind::Missing => "",
            FindingKind::Score => " by all of their scores",
            _ => return None,
        };
        let Finding { preset, method, count, example, .. } = finding;
        let targets = if *count == 1 { "target of the old baseline is" } else { "targets of the old baseline are" };
        Some(format!("{preset}, {method}: {count} {targets} no longer guarded{by}, such as {example}"))
    };
    report.findings.iter().filter_map(line).collect()
}

/// The accepted baseline.
#[derive(Debug, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct AcceptanceReport {
    baseline: PathBuf,
    /// The worst verdict on a number against the old baseline, if there was one; whatever else has changed.
    moved: Option<DriftVerdict>,
    /// What the old baseline guards and this one does not.
    no_longer_guarded: Vec<String>,
    /// What else has changed since the old baseline: protocols, trials, images, statuses and the like.
    changed: Vec<String>,
    accepted: Acceptance,
    acceptances: usize,
    trials: usize,
    targets: usize,
    /// Targets without a render or a truth, other than those of trials that the method does not support.
    failed: usize,
    /// Targets with NaN or infinite samples.
    non_finite: usize,
    /// Which part of a run it is; `None` for a whole run.
    part: Option<String>,
    /// Protocols of which a limit left scenes out.
    limited: Vec<String>,
    /// What else the run is missing, such as skipped entries.
    gaps: Vec<String>,
    /// Metrics that were not computed, each with the reason.
    absent_metrics: Vec<String>,
    /// Learned metrics with other weights than the published ones.
    unpublished_weights: Vec<String>,
    /// Scores of the run that its repetitions lack.
    lacking_in_repetitions: Vec<String>,
    limits: Vec<Limit>,
    /// Whether the limits from repeated runs are those of an earlier acceptance.
    keeps_limits: bool,
    probe: Option<Recipe>,
}

impl AcceptanceReport {
    /// Summarises a baseline of `results` and their repetitions that was written to `path`; `report` compares them with the one before,
    /// if there was one.
    pub fn new(
        path: &Path,
        baseline: Baseline,
        accepted: Acceptance,
        results: &Results,
        repeats: &[Results],
        report: Option<&DriftReport>,
    ) -> Self {
        let unsupported = baseline.trials.iter().filter(|trial| trial.status == TrialStatus::NotApplicable);
        let unsupported: BTreeSet<&TrialKey> = unsupported.map(|trial| &trial.key).collect();
        let supported = |target: &&BaselineTarget| !unsupported.contains(&target.key);
        let count = |status| baseline.targets.iter().filter(supported).filter(|row| row.status == status).count();
        let [failed, non_finite] = [TargetStatus::Failed, TargetStatus::NonFinite].map(count);
        Self {
            baseline: path.to_owned(),
            moved: report.map(verdict_of_numbers),
            no_longer_guarded: report.map_or_else(Vec::new, no_longer_guarded),
            changed: report.map_or_else(Vec::new, other_changes),
            accepted,
            acceptances: baseline.history.len(),
            trials: baseline.trials.len(),
            targets: baseline.targets.len(),
            failed,
            non_finite,
            part: baseline.provenance.part(),
            limited: limited(&baseline.provenance),
            gaps: gaps(results),
            absent_metrics: absent_metrics(&baseline.provenance),
            unpublished_weights: baseline.provenance.metrics.iter().filter_map(MetricRecord::unpublished).collect(),
            lacking_in_repetitions: lacking_scores(results, repeats),
            // Without repetitions of this run, none was estimated now.
            keeps_limits: repeats.is_empty() && baseline.limits.iter().any(Limit::is_estimated),
            limits: baseline.limits,
            probe: baseline.probe.map(|probe| probe.recipe),
        }
    }

    /// What the old baseline guards and this one does not, a line for each protocol, method and kind; nothing without an old one.
    pub fn no_longer_guarded(&self) -> &[String] {
        &self.no_longer_guarded
    }

    /// Scores of the run that its repetitions lack, and that limits are therefore not from: a line for each repetition and number.
    pub fn lacking_in_repetitions(&self) -> &[String] {
        &self.lacking_in_repetitions
    }
}

/// The worst verdict on a number; [`DriftVerdict::Nothing`] if none was compared.
fn verdict_of_numbers(report: &DriftReport) -> DriftVerdict {
    let verdicts = report.comparisons.iter().map(|comparison| comparison.verdict);
    verdicts.filter(|verdict| *verdict != DriftVerdict::Nothing).max().unwrap_or(DriftVerdict::Nothing)
}

/// The findings that are drift, except for those of [`no_longer_guarded`].
fn other_changes(report: &DriftReport) -> Vec<String> {
    let is_other = |finding: &&Finding| {
        finding.verdict == DriftVerdict::Drifted && !matches!(finding.kind, FindingKind::Missing | FindingKind::Score)
    };
    report.findings.iter().filter(is_other).map(ToString::to_string).collect()
}

fn limited(provenance: &Provenance) -> Vec<String> {
    let Some(limit) = provenance.limit else { return Vec::new() };
    let partial = provenance.presets.iter().filter(|preset| preset.entries < preset.entries_of_index);
    let line = |preset: &atsplat_results::PresetRecord| {
        let (entries, all) = (preset.entries, preset.entries_of_index);
        format!("{}: {entries} of {all} index entries, by a limit of {limit} scenes", preset.name)
    };
    partial.map(line).collect()
}

/// Gaps that are neither targets without a score nor other parts of the run.
fn gaps(results: &Results) -> Vec<String> {
    let is_counted = |kind| matches!(kind, GapKind::MissingShards | GapKind::Incomplete | GapKind::NonFinite);
    let gaps = results.gaps().into_iter().filter(|gap| !is_counted(gap.kind));
    gaps.map(|gap| gap.to_string()).collect()
}

fn absent_metrics(provenance: &Provenance) -> Vec<String> {
    let line = |metric: &MetricRecord| Some(format!("{}: {}", metric.id, metric.reason_of_absence()?));
    provenance.metrics.iter().filter_map(line).collect()
}

impl AcceptanceReport {
    /// What is wrong with the baseline, or not in it.
    fn warnings(&self) -> Vec<String> {
        let mut warnings = Vec::new();
        for (count, why) in [(self.failed, "failed"), (self.non_finite, "with NaN or infinite samples")] {
            if count > 0 {
                warnings.push(format!("without a score: {} {why}", counted(count as u64, "target")));
            }
        }
        let part = self.part.iter().map(|part| format!("a part of the run, {part}: the others are not guarded"));
        warnings.extend(part);
        for found in &self.unpublished_weights {
            warnings.push(format!("the weights of a learned metric are not the published ones: {found}"));
        }
        warnings.extend(self.absent_metrics.iter().map(|found| format!("a metric is not guarded: {found}")));
        warnings.extend(self.limited.iter().map(|found| format!("{found}: the others are not guarded")));
        warnings.extend(self.gaps.iter().chain(&self.no_longer_guarded).chain(&self.lacking_in_repetitions).cloned());
        warnings
    }
}

impl fmt::Display for AcceptanceReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self {
            baseline, moved, accepted, acceptances, trials, targets, changed, limits, keeps_limits, probe, ..
        } = self;
        let (trials, targets) = (counted(*trials as u64, "trial"), counted(*targets as u64, "target"));
        writeln!(f, "{}: {targets} of {trials}, accepted on {}", baseline.display(), accepted.date)?;
        for warning in self.warnings() {
            writeln!(f, "warning: {warning}")?;
        }
        for finding in changed {
            writeln!(f, "changed: {finding}")?;
        }
        match moved {
            None => writeln!(f, "a new baseline")?,
            Some(DriftVerdict::Drifted) => writeln!(f, "numbers moved; acceptance {acceptances} of this baseline")?,
            Some(DriftVerdict::Nothing) => {
                writeln!(
                    f,
                    "the old baseline contains none of these numbers; acceptance {acceptances} of this baseline"
                )?;
            }
            Some(DriftVerdict::Within) => {
                writeln!(f, "no number moved beyond its limit; acceptance {acceptances} of this baseline")?;
            }
            Some(DriftVerdict::Same) => writeln!(f, "no number moved; acceptance {acceptances} of this baseline")?,
        }
        for limit in limits {
            let is_kept = *keeps_limits && limit.is_estimated();
            writeln!(f, "{limit}{}", if is_kept { "; kept from an earlier acceptance" } else { "" })?;
            if let Some(times) = limit.times_least_limit() {
                let advice = if limit.is_stated() { "" } else { "; more repeated runs estimate it better" };
                writeln!(
                    f,
                    "warning: its mean may vary by {times:.0} times the least limit: smaller changes will pass{advice}"
                )?;
            }
        }
        match probe {
            Some(recipe) => writeln!(f, "probe: {} with constants {}", recipe.model, recipe.constants),
            None => writeln!(f, "no probe: drift will not be attributed"),
        }
    }
}
