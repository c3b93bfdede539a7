//! `atsplat merge`: merges the shards of a run into one store.

use std::fmt;
use std::path::PathBuf;

use anyhow::{Context as _, bail};
use atsplat_results::store::{Merged, repeated_store};
use atsplat_results::{Results, RunReport};
use serde::Serialize;

use crate::objects::CacheArgs;
use crate::parse::usage_error;
use crate::print::{note, print_report, warn};
use crate::provenance;

#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// Stores that `atsplat run --shard` filled, also as URLs.
    #[arg(value_name = "STORE", required = true)]
    stores: Vec<PathBuf>,

    /// Folder of the merged results, or a URL (s3://, gs://, az://).
    #[arg(long, short, value_name = "STORE")]
    out: PathBuf,

    /// Merge even if shards are missing or not done; the result, and tables made from it, are marked as partial.
    #[arg(long)]
    partial: bool,

    #[command(flatten)]
    cache: CacheArgs,

    /// Print JSON.
    #[arg(long)]
    json: bool,
}

#[derive(Serialize)]
#[serde(rename_all = "kebab-case")]
struct Report<'a> {
    #[serde(flatten)]
    run: RunReport,
    /// Why the results are not those of the whole run; empty if they are.
    partial: &'a [String],
}

impl fmt::Display for Report<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        fmt::Display::fmt(&self.run, f)
    }
}

/// Merges; `true` if no shard is missing and nothing was skipped or failed in any of them.
pub(crate) fn run(args: &Args) -> anyhow::Result<bool> {
    reject_duplicates(&args.stores)?;
    let reading = |store: &PathBuf| format!("reading {}", store.display());
    let folders = args.stores.iter().map(|store| args.cache.store(store).with_context(|| reading(store)));
    let folders = folders.collect::<anyhow::Result<Vec<PathBuf>>>()?;
    let parts = args.stores.iter().zip(Results::read_each(&folders));
    let parts = parts.map(|(store, results)| results.with_context(|| reading(store)));
    let merged = Results::merge(parts.collect::<anyhow::Result<Vec<_>>>()?);
    let merged = merged.map_err(|error| match error.part.and_then(|at| args.stores.get(at)) {
        Some(store) => anyhow::Error::new(error).context(format!("merging {}", store.display())),
        None => error.into(),
    })?;
    let reasons = merged.why_incomplete();
    if !reasons.is_empty() && !args.partial {
        bail!("{}: --partial merges the other results", reasons.join("; "));
    }
    let Merged { mut results, repeated, .. } = merged;
    results.provenance.add_command(&provenance().command);
    let (out, is_changed) = args.cache.output(&args.out, |folder| Ok(results.write_merged(folder, &folders)?))?;
    out.finish()?;
    let run = RunReport::of(&results, None, &args.out);
    print_report(&Report { run, partial: &reasons }, args.json)?;
    for reason in &reasons {
        warn(&format!("the results are partial: {reason}"));
    }
    if args.partial && reasons.is_empty() {
        note("--partial has no effect: no shard is missing or unfinished");
    }
    if !is_changed {
        note(&format!("{} has exactly these results already: nothing was left to do", args.out.display()));
    }
    if repeated > 0 {
        warn(&format!("{repeated} results are in several stores with equal values; each is merged once"));
    }
    Ok(reasons.is_empty() && results.gaps().is_empty())
}

/// Rejects stores that are given twice, even by different paths.
pub(crate) fn reject_duplicates(stores: &[PathBuf]) -> anyhow::Result<()> {
    let Some([store, first]) = repeated_store(stores) else { return Ok(()) };
    let (store, first) = (store.display(), first.display());
    Err(usage_error(format!("{store} is the same store as {first}: name each store once")).into())
}
