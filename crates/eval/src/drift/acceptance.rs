use std::collections::BTreeSet;
use std::fmt;
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use super::probe::Recipe;
use super::{Baseline, BaselineTarget, DriftError, Limit, Verdict};
use crate::{MetricRecord, Results, TargetStatus, TrialKey, TrialStatus};

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
    let refused = |expected, found| Err(DriftError::Unacceptable { expected, found });
    if results.targets.iter().all(|row| row.scores.is_empty()) {
        let count = results.targets.len();
        let targets = if count == 1 { "target" } else { "targets" };
        let found = format!("{count} {targets} without scores; an empty baseline cannot detect drift");
        return refused("results with scores", found);
    }
    match results.interrupted().first() {
        Some(run) => refused("a finished run", format!("{run}; the command that started it resumes it")),
        None => Ok(()),
    }
}

/// The accepted baseline.
#[derive(Debug, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct AcceptanceReport {
    baseline: PathBuf,
    /// Verdict of the new numbers against the old baseline, if there was one.
    moved: Option<Verdict>,
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
    /// Learned metrics with other weights than the published ones.
    unpublished_weights: Vec<String>,
    limits: Vec<Limit>,
    probe: Option<Recipe>,
}

impl AcceptanceReport {
    /// Summarises a baseline that was written to `path`; `moved` is the verdict against the one before, if there was one.
    pub fn new(path: &Path, baseline: Baseline, accepted: Acceptance, moved: Option<Verdict>) -> Self {
        let unsupported = baseline.trials.iter().filter(|trial| trial.status == TrialStatus::NotApplicable);
        let unsupported: BTreeSet<&TrialKey> = unsupported.map(|trial| &trial.key).collect();
        let supported = |target: &&BaselineTarget| !unsupported.contains(&target.key);
        let count = |status| baseline.targets.iter().filter(supported).filter(|own| own.status == status).count();
        let [failed, non_finite] = [TargetStatus::Failed, TargetStatus::NonFinite].map(count);
        Self {
            baseline: path.to_owned(),
            moved,
            accepted,
            acceptances: baseline.history.len(),
            trials: baseline.trials.len(),
            targets: baseline.targets.len(),
            failed,
            non_finite,
            part: baseline.provenance.part(),
            unpublished_weights: baseline.provenance.metrics.iter().filter_map(MetricRecord::unpublished).collect(),
            limits: baseline.limits,
            probe: baseline.probe.map(|probe| probe.recipe),
        }
    }
}

impl fmt::Display for AcceptanceReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { baseline, moved, accepted, acceptances, trials, targets, failed, non_finite, .. } = self;
        let Self { part, unpublished_weights, limits, probe, .. } = self;
        let counted = |count: usize, what: &str| format!("{count} {what}{}", if count == 1 { "" } else { "s" });
        let (trials, targets) = (counted(*trials, "trial"), counted(*targets, "target"));
        writeln!(f, "{}: {targets} of {trials}, accepted on {}", baseline.display(), accepted.date)?;
        for (count, why) in [(*failed, "failed"), (*non_finite, "with NaN or infinite samples")] {
            if count > 0 {
                writeln!(f, "warning: without a score: {} {why}", counted(count, "target"))?;
            }
        }
        if let Some(part) = part {
            writeln!(f, "warning: a part of the run, {part}: the others are not guarded")?;
        }
        for found in unpublished_weights {
            writeln!(f, "warning: the weights of a learned metric are not the published ones: {found}")?;
        }
        match moved {
            None => writeln!(f, "a new baseline")?,
            Some(Verdict::Drifted) => writeln!(f, "numbers moved; acceptance {acceptances} of this baseline")?,
            Some(Verdict::Nothing) => {
                writeln!(f, "the old baseline holds none of these numbers; acceptance {acceptances} of this baseline")?;
            }
            Some(Verdict::Within) => {
                writeln!(f, "no number moved beyond its limit; acceptance {acceptances} of this baseline")?;
            }
            Some(Verdict::Same) => writeln!(f, "no number moved; acceptance {acceptances} of this baseline")?,
        }
        for limit in limits {
            writeln!(f, "{limit}")?;
            if let Some(times) = limit.wide() {
                writeln!(
                    f,
                    "warning: that is {times:.0} times the least limit: smaller changes will pass; more repeated runs \
                     estimate it better"
                )?;
            }
        }
        match probe {
            Some(recipe) => writeln!(f, "probe: {} with constants {}", recipe.model, recipe.constants),
            None => writeln!(f, "no probe: drift will not be attributed"),
        }
    }
}
