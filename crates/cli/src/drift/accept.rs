use std::fmt;
use std::path::PathBuf;

use atsplat_eval::Results;
use atsplat_eval::drift::probe::{Inputs, Pipeline, Recipe, run as run_probe};
use atsplat_eval::drift::{Acceptance, Baseline, Limit, Verdict, compare, date};
use clap::builder::NonEmptyStringValueParser;
use serde::Serialize;

use super::recipe;
use crate::exit::Exit;
use crate::output::print_report;
use crate::provenance;

#[derive(Debug, clap::Args)]
pub(super) struct Args {
    /// Folder of results.
    store: PathBuf,

    /// Baseline file to create or replace.
    #[arg(long, value_name = "FILE")]
    baseline: PathBuf,

    /// Why these numbers are correct, kept in the baseline's history.
    #[arg(long, value_name = "TEXT", value_parser = NonEmptyStringValueParser::new())]
    why: String,

    /// Results of a repetition of the run; may be given several times. Numbers that are not deterministic may later move as
    /// far as these differ.
    #[arg(long, value_name = "STORE")]
    repeat: Vec<PathBuf>,

    /// Recipe of the probe, in TOML; by default that of the old baseline, or the smallest one.
    #[arg(long, value_name = "FILE", conflicts_with = "no_probe")]
    probe: Option<PathBuf>,

    /// Store no probe: drift will be detected but not attributed.
    #[arg(long)]
    no_probe: bool,

    /// Print JSON.
    #[arg(long)]
    json: bool,
}

/// The accepted baseline.
#[derive(Serialize)]
#[serde(rename_all = "kebab-case")]
struct Report {
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

pub(super) fn run(args: &Args) -> anyhow::Result<Exit> {
    let requested = args.probe.as_deref().map(recipe).transpose()?;
    let before = if args.baseline.exists() { Some(Baseline::read(&args.baseline)?) } else { None };
    let results = Results::read(&args.store)?;
    let repeats = args.repeat.iter().map(|store| Results::read(store)).collect::<Result<Vec<_>, _>>()?;
    let scored = results.targets.iter().filter(|row| !row.scores.is_empty()).count();
    anyhow::ensure!(
        scored > 0,
        "{}: expected results with scores, found {} targets without scores; an empty baseline cannot detect drift",
        args.store.display(),
        results.targets.len()
    );
    let now = provenance();
    let acceptance = Acceptance {
        date: date(now.started),
        reason: args.why.clone(),
        atsplat: results.provenance.atsplat.clone(),
        commit: results.provenance.commit.clone(),
    };
    let moved = before.as_ref().map(|before| compare(&results, before).verdict);
    let mut baseline = match &before {
        Some(before) => before.accept(&results, &repeats, acceptance.clone()),
        None => Baseline::new(&results, &repeats, acceptance.clone()),
    };
    let recipe = requested.or_else(|| Some(before.as_ref()?.probe.as_ref()?.recipe.clone())).unwrap_or_default();
    if !args.no_probe {
        let stages = Pipeline::of(&recipe)?;
        let outputs = run_probe(&stages, &Inputs::pattern(&stages.options.constants)?)?;
        Baseline::write_probe(&args.baseline, &outputs)?;
        baseline = baseline.with_probe(recipe, &outputs);
    }
    baseline.write(&args.baseline)?;
    let report = Report {
        baseline: args.baseline.clone(),
        moved,
        accepted: acceptance,
        acceptances: baseline.history.len(),
        trials: baseline.trials.len(),
        targets: baseline.targets.len(),
        limits: baseline.limits,
        probe: baseline.probe.map(|probe| probe.recipe),
    };
    print_report(&report, args.json)?;
    Ok(Exit::Done)
}

impl fmt::Display for Report {
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
