use std::fmt;
use std::path::{Path, PathBuf};

use serde::Serialize;

use super::probe::Recipe;
use super::{Acceptance, Baseline, DriftError, Limit, Verdict};
use crate::Results;
use crate::store::Unfinished;

/// Checks that results can become a baseline.
///
/// # Errors
/// [`DriftError::Unacceptable`] for results without scores, which cannot detect drift, and for a run that has not ended.
pub fn acceptable(results: &Results) -> Result<(), DriftError> {
    let refused = |expected, found| Err(DriftError::Unacceptable { expected, found });
    if results.targets.iter().all(|row| row.scores.is_empty()) {
        let count = results.targets.len();
        let found = format!("{count} targets without scores; an empty baseline cannot detect drift");
        return refused("results with scores", found);
    }
    let has_trials = |run: &&Unfinished| {
        results.trials.iter().any(|trial| (&trial.key.preset, &trial.key.method) == (&run.preset, &run.method))
    };
    match results.unfinished().iter().find(has_trials) {
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
    limits: Vec<Limit>,
    probe: Option<Recipe>,
}

impl AcceptanceReport {
    /// Summarises a baseline that was written to `path`; `moved` is the verdict against the one before, if there was one.
    pub fn new(path: &Path, baseline: Baseline, accepted: Acceptance, moved: Option<Verdict>) -> Self {
        Self {
            baseline: path.to_owned(),
            moved,
            accepted,
            acceptances: baseline.history.len(),
            trials: baseline.trials.len(),
            targets: baseline.targets.len(),
            limits: baseline.limits,
            probe: baseline.probe.map(|probe| probe.recipe),
        }
    }
}

impl fmt::Display for AcceptanceReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { baseline, moved, accepted, acceptances, trials, targets, limits, probe } = self;
        writeln!(f, "{}: {targets} targets of {trials} trials, accepted on {}", baseline.display(), accepted.date)?;
        match moved {
            None => writeln!(f, "a new baseline")?,
            Some(Verdict::Drifted) => writeln!(f, "numbers moved; acceptance {acceptances} of this baseline")?,
            Some(Verdict::Nothing) => {
                writeln!(f, "the old baseline had none of these numbers; acceptance {acceptances} of this baseline")?;
            }
            Some(_) => writeln!(f, "no number moved; acceptance {acceptances} of this baseline")?,
        }
        for limit in limits {
            writeln!(f, "{limit}")?;
        }
        match probe {
            Some(recipe) => writeln!(f, "probe: {} with constants {}", recipe.model, recipe.constants),
            None => writeln!(f, "no probe: drift will not be attributed"),
        }
    }
}
