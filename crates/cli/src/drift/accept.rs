use std::path::PathBuf;

use atsplat_eval::Results;
use atsplat_eval::drift::probe::{Inputs, Pipeline, run as run_probe};
use atsplat_eval::drift::{Acceptance, AcceptanceReport, Baseline, compare, date};
use atsplat_eval::store::Unfinished;
use clap::builder::NonEmptyStringValueParser;

use super::recipe;
use crate::exit::Exit;
use crate::objects::CacheArgs;
use crate::output::print_report;
use crate::provenance;

#[derive(Debug, clap::Args)]
pub(super) struct Args {
    /// Folder of results, or its URL (s3://, gs://, az://).
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

    #[command(flatten)]
    cache: CacheArgs,

    /// Print JSON.
    #[arg(long)]
    json: bool,
}

pub(super) fn run(args: &Args) -> anyhow::Result<Exit> {
    let requested = args.probe.as_deref().map(recipe).transpose()?;
    let before = if args.baseline.exists() { Some(Baseline::read(&args.baseline)?) } else { None };
    let read = |store: &PathBuf| Ok::<_, anyhow::Error>(Results::read(&args.cache.store(store)?)?);
    let results = read(&args.store)?;
    let repeats = args.repeat.iter().map(read).collect::<anyhow::Result<Vec<_>>>()?;
    let scored = results.targets.iter().filter(|row| !row.scores.is_empty()).count();
    anyhow::ensure!(
        scored > 0,
        "{}: expected results with scores, found {} targets without scores; an empty baseline cannot detect drift",
        args.store.display(),
        results.targets.len()
    );
    let begun = |own: &&Unfinished| {
        results.trials.iter().any(|trial| (&trial.key.preset, &trial.key.method) == (&own.preset, &own.method))
    };
    if let Some(unfinished) = results.unfinished().iter().find(begun) {
        anyhow::bail!(
            "{}: expected a finished run, found {unfinished}; the command that began it goes on where it stopped",
            args.store.display()
        );
    }
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
    print_report(&AcceptanceReport::new(&args.baseline, baseline, acceptance, moved), args.json)?;
    Ok(Exit::Done)
}
