//! `atsplat merge`: the shards of a run into one store.

use std::path::PathBuf;

use anyhow::bail;
use atsplat_eval::Results;
use atsplat_eval::store::Merged;
use clap::Args;

use super::read;
use super::report::Report;
use crate::output::print_report;

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
    let Merged { results, missing_shards } = Results::merge(read(&words.stores)?)?;
    if !missing_shards.is_empty() && !words.partial {
        let missing: Vec<String> = missing_shards.iter().map(ToString::to_string).collect();
        bail!("shards {} are missing: --partial merges what is there", missing.join(", "));
    }
    results.write(&words.out)?;
    print_report(&Report::of(&results, None, &words.out), words.json)?;
    Ok(missing_shards.is_empty())
}
