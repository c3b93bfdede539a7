//! `atsplat merge`: the shards of a run into one store.

use std::path::PathBuf;

use anyhow::bail;
use atsplat_eval::store::Merged;
use atsplat_eval::{Results, RunReport};

use super::read;
use crate::output::{print_report, warn};

#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// Stores that `atsplat run --shard` filled.
    #[arg(value_name = "STORE", required = true)]
    stores: Vec<PathBuf>,

    /// Folder of the merged results.
    #[arg(long, short, value_name = "STORE")]
    out: PathBuf,

    /// Merge even if shards are missing or not done; the result is marked as partial.
    #[arg(long)]
    partial: bool,

    /// Print JSON.
    #[arg(long)]
    json: bool,
}

pub(crate) fn run(args: &Args) -> anyhow::Result<bool> {
    reject_duplicates(&args.stores)?;
    let merged = Results::merge(read(&args.stores)?)?;
    let lacking = merged.lacking();
    if !lacking.is_empty() && !args.partial {
        bail!("{}: --partial merges the other results", lacking.join("; "));
    }
    let Merged { results, repeated, .. } = merged;
    results.write(&args.out)?;
    print_report(&RunReport::of(&results, None, &args.out), args.json)?;
    if repeated > 0 {
        warn(&format!("warning: {repeated} results stood in several stores with equal values, and were taken once"));
    }
    Ok(lacking.is_empty())
}

/// Rejects stores that are given twice, even by different paths.
fn reject_duplicates(stores: &[PathBuf]) -> anyhow::Result<()> {
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
