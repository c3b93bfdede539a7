//! `atsplat merge`: the shards of a run into one store.

use std::path::PathBuf;

use anyhow::bail;
use atsplat_eval::Results;
use atsplat_eval::store::Merged;
use clap::Args;

use super::read;
use super::report::Report;
use crate::output::{complain, print_report};

#[derive(Debug, Args)]
pub(crate) struct Words {
    /// Stores that `atsplat run --shard` filled.
    #[arg(value_name = "STORE", required = true)]
    stores: Vec<PathBuf>,

    /// Folder of the merged results.
    #[arg(long, short, value_name = "STORE")]
    out: PathBuf,

    /// Merge even where shards are missing; the result says that it is a part.
    #[arg(long)]
    partial: bool,

    /// Print JSON.
    #[arg(long)]
    json: bool,
}

pub(crate) fn run(words: &Words) -> anyhow::Result<bool> {
    each_once(&words.stores)?;
    let Merged { results, missing_shards, repeated } = Results::merge(read(&words.stores)?)?;
    if !missing_shards.is_empty() && !words.partial {
        let missing: Vec<String> = missing_shards.iter().map(ToString::to_string).collect();
        bail!("shards {} are missing: --partial merges what is there", missing.join(", "));
    }
    results.write(&words.out)?;
    print_report(&Report::of(&results, None, &words.out), words.json)?;
    if repeated > 0 {
        complain(&format!(
            "warning: {repeated} results stood in several stores, the same in each, and were taken once"
        ));
    }
    Ok(missing_shards.is_empty())
}

/// Refuses a store that is named twice, by whichever paths.
fn each_once(stores: &[PathBuf]) -> anyhow::Result<()> {
    let mut seen: Vec<(PathBuf, &PathBuf)> = Vec::new();
    for store in stores {
        // One that is not there is told when it is read.
        let place = store.canonicalize().unwrap_or_else(|_| store.clone());
        if let Some((_, first)) = seen.iter().find(|(known, _)| *known == place) {
            bail!("{} is the same store as {}: name each store once", store.display(), first.display());
        }
        seen.push((place, store));
    }
    Ok(())
}
