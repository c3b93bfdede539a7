use std::path::{Path, PathBuf};

use anyhow::{Context as _, bail};
use atsplat_drift::{Baseline, NewBaseline, ProbeChoice, acceptable, check_repetition};
use atsplat_results::Results;
use clap::builder::NonEmptyStringValueParser;

use super::recipe;
use crate::exit::Exit;
use crate::objects::CacheArgs;
use crate::output_lock::OutputFiles;
use crate::parse::{self, once, usage_error};
use crate::print::{print_report, warn};

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

    /// Results of a repetition of the run, with the same protocols, methods and data; may be given several times. Numbers that
    /// are not deterministic may later change as much as these differ, also in later baselines until --limit or --repeat is given again.
    #[arg(long, value_name = "STORE")]
    repeat: Vec<PathBuf>,

    /// How far the mean of a metric may change in methods that are not deterministic, in its unit, such as psnr=0.05, instead of what
    /// --repeat shows; may be given for several metrics. It stays in later baselines until --limit or --repeat is given again.
    #[arg(long, value_name = "METRIC=CHANGE", value_parser = limit)]
    limit: Vec<(String, f64)>,

    /// Recipe of the probe, in TOML; by default that of the old baseline, or the smallest one.
    #[arg(long, value_name = "FILE", conflicts_with = "no_probe")]
    probe: Option<PathBuf>,

    /// Store no probe: drift will be detected but not attributed.
    #[arg(long)]
    no_probe: bool,

    /// Write no baseline and exit with code 4 if the results are incomplete: shards, scenes or frames are missing, entries were
    /// skipped, or a trial failed, has samples that are NaN or infinite, or rendered no Gaussian.
    #[arg(long)]
    strict: bool,

    #[command(flatten)]
    cache: CacheArgs,

    /// Print JSON.
    #[arg(long)]
    json: bool,
}

pub(super) fn run(args: &Args) -> anyhow::Result<Exit> {
    let limited: Vec<String> = args.limit.iter().map(|(metric, _)| metric.clone()).collect();
    once("--limit", &limited).map_err(usage_error)?;
    let probe = match &args.probe {
        _ if args.no_probe => ProbeChoice::None,
        Some(path) => ProbeChoice::Recipe(recipe(path)?),
        None => ProbeChoice::Kept,
    };
    // Before it is read, as another process may be about to replace it.
    let _outputs = OutputFiles::of([args.baseline.as_path()])?;
    let before = Baseline::read_if_exists(&args.baseline)?;
    let (place, results) = read(&args.store, &args.cache)?;
    acceptable(&results).with_context(|| args.store.display().to_string())?;
    let gaps = if args.strict { results.gaps() } else { Vec::new() };
    if !gaps.is_empty() {
        for gap in &gaps {
            warn(&format!("{}: {gap}", args.store.display()));
        }
        warn(&format!("--strict: {} was not written", args.baseline.display()));
        return Ok(Exit::Incomplete);
    }
    let repeats = repeats(args, place, &results)?;
    let (limits, why) = (args.limit.as_slice(), args.why.as_str());
    let new_baseline = NewBaseline { results: &results, repeats: &repeats, limits, why, probe };
    print_report(&new_baseline.write(&args.baseline, before.as_ref())?, args.json)?;
    Ok(Exit::Done)
}

fn limit(text: &str) -> Result<(String, f64), String> {
    let (metric, change) =
        text.split_once('=').ok_or_else(|| "expected METRIC=CHANGE, such as psnr=0.05".to_owned())?;
    Ok((parse::metric(metric)?, parse::positive(change)?))
}

/// Results and their folder, which is the same for every path to it.
fn read(store: &Path, cache: &CacheArgs) -> anyhow::Result<(PathBuf, Results)> {
    let folder = cache.store(store)?;
    let results = Results::read(&folder)?;
    let place = folder.canonicalize().with_context(|| format!("reading {}", store.display()))?;
    Ok((place, results))
}

/// The results of the run's repetitions; `place` is the folder of the run's own.
fn repeats(args: &Args, place: PathBuf, results: &Results) -> anyhow::Result<Vec<Results>> {
    if !args.repeat.is_empty() && results.provenance.methods.iter().all(|method| method.deterministic) {
        return Err(usage_error("--repeat has no effect: every method of the results is deterministic").into());
    }
    let mut seen = vec![(place, &args.store)];
    let mut repeats = Vec::new();
    for store in &args.repeat {
        let (place, repeat) = read(store, &args.cache)?;
        if let Some((_, first)) = seen.iter().find(|(other, _)| *other == place) {
            bail!("--repeat {} is the same store as {}: name each run once", store.display(), first.display());
        }
        check_repetition(results, &repeats, &repeat).with_context(|| format!("--repeat {}", store.display()))?;
        seen.push((place, store));
        repeats.push(repeat);
    }
    Ok(repeats)
}
