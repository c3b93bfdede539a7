//! Makes results a baseline.

use std::path::Path;

use atsplat_files::{date, unix_seconds};
use atsplat_results::Results;

use super::probe::Recipe;
use super::{Acceptance, AcceptanceReport, Baseline, DriftError, acceptable, compare};

/// Results that become a baseline, and what the baseline has besides them.
#[derive(Clone, Debug)]
pub struct NewBaseline<'a> {
    /// The results.
    pub results: &'a Results,
    /// Those of repetitions of the run, which passed [`super::check_repetition`].
    pub repeats: &'a [Results],
    /// Ids of metrics with the limits that are stated for them.
    pub limits: &'a [(String, f64)],
    /// Why the numbers are correct.
    pub why: &'a str,
    /// The probe that is run on this machine and stored.
    pub probe: ProbeChoice,
}

/// Which probe a baseline has.
#[derive(Clone, Debug, PartialEq)]
pub enum ProbeChoice {
    /// None: drift will be detected but not attributed.
    None,
    /// That of the old baseline; without one, the smallest.
    Kept,
    /// One of this recipe.
    Recipe(Recipe),
}

impl NewBaseline<'_> {
    /// Writes the baseline, which continues the history of the one `before` it, if there was one.
    ///
    /// # Errors
    /// Those of [`acceptable`], [`Baseline::with_limit`], [`Baseline::probed`] and [`Baseline::write_with_probe`], and
    /// [`DriftError::Invalid`] without a reason; nothing is written then.
    pub fn write(self, path: &Path, before: Option<&Baseline>) -> Result<AcceptanceReport, DriftError> {
        let Self { results, repeats, limits, why, probe } = self;
        if why.trim().is_empty() {
            return Err(DriftError::invalid("why", "a reason why these numbers are correct", "none"));
        }
        acceptable(results)?;
        let acceptance = Acceptance {
            date: date(unix_seconds()),
            reason: why.to_owned(),
            atsplat: results.provenance.atsplat.clone(),
            commit: results.provenance.commit.clone(),
        };
        let report = before.map(|before| compare(results, before));
        let mut baseline = match before {
            Some(before) => before.accept(results, repeats, acceptance.clone()),
            None => Baseline::new(results, repeats, acceptance.clone()),
        };
        for (metric, limit) in limits {
            baseline = baseline.with_limit(metric, *limit)?;
        }
        let recipe = match probe {
            ProbeChoice::None => None,
            ProbeChoice::Kept => {
                let kept = before.and_then(|before| before.probe.as_ref());
                Some(kept.map(|probe| probe.recipe.clone()).unwrap_or_default())
            }
            ProbeChoice::Recipe(recipe) => Some(recipe),
        };
        if let Some(recipe) = recipe {
            let (probed, values) = baseline.probed(recipe)?;
            probed.write_with_probe(path, &values)?;
            baseline = probed;
        } else {
            baseline.write(path)?;
        }
        Ok(AcceptanceReport::new(path, baseline, acceptance, results, repeats, report.as_ref()))
    }
}
