//! `atsplat merge`: merges the shards of a run into one store.

use std::path::{Path, PathBuf};

use anyhow::{Context as _, bail};
use atsplat_eval::store::Merged;
use atsplat_eval::{Results, RunReport};

use crate::objects::CacheArgs;
use crate::print::{print_report, warn};

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

pub(crate) fn run(args: &Args) -> anyhow::Result<bool> {
    reject_duplicates(&args.stores)?;
    let merged =
        Results::merge(args.stores.iter().map(|store| read(store, &args.cache)).collect::<anyhow::Result<_>>()?)?;
    let reasons = merged.why_incomplete();
    if !reasons.is_empty() && !args.partial {
        bail!("{}: --partial merges the other results", reasons.join("; "));
    }
    let Merged { results, repeated, .. } = merged;
    let (out, ()) = args.cache.output(&args.out, |folder| Ok(results.write(folder)?))?;
    out.finish()?;
    print_report(&RunReport::of(&results, None, &args.out), args.json)?;
    for reason in &reasons {
        warn(&format!("the results are partial: {reason}"));
    }
    if repeated > 0 {
        warn(&format!("{repeated} results are in several stores with equal values; each is merged once"));
    }
    Ok(reasons.is_empty())
}

fn read(store: &Path, cache: &CacheArgs) -> anyhow::Result<Results> {
    let read = || Ok::<_, anyhow::Error>(Results::read(&cache.store(store)?)?);
    read().with_context(|| format!("reading {}", store.display()))
}

/// Rejects stores that are given twice, even by different paths.
pub(crate) fn reject_duplicates(stores: &[PathBuf]) -> anyhow::Result<()> {
    let mut seen: Vec<(PathBuf, &PathBuf)> = Vec::new();
    for store in stores {
        // A missing store is reported when it is read.
        let place = store.canonicalize().unwrap_or_else(|_| store.clone());
        if let Some((_, first)) = seen.iter().find(|(other, _)| *other == place) {
            bail!("{} is the same store as {}: name each store once", store.display(), first.display());
        }
        seen.push((place, store));
    }
    Ok(())
}
