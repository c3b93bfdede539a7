//! Results against a baseline: verdict, attribution, exit code 3.

mod accept;
mod check;
mod history;

use std::path::{Path, PathBuf};

use anyhow::Context as _;
use atsplat_eval::drift::probe::Recipe;
use clap::{Args, Subcommand};

use crate::exit::Exit;

#[derive(Debug, Args)]
#[command(args_conflicts_with_subcommands = true, subcommand_negates_reqs = true)]
pub(crate) struct Words {
    #[command(subcommand)]
    command: Option<Command>,

    /// Folder of results.
    #[arg(required = true)]
    store: Option<PathBuf>,

    /// The baseline.
    #[arg(long, value_name = "FILE", required = true)]
    baseline: Option<PathBuf>,

    /// Run the probe as this recipe says, in TOML, and not as the baseline's does.
    #[arg(long, value_name = "FILE", conflicts_with = "no_probe")]
    probe: Option<PathBuf>,

    /// Compare rows alone, and attribute nothing.
    #[arg(long)]
    no_probe: bool,

    #[command(flatten)]
    history: history::HistoryWords,

    /// Print JSON.
    #[arg(long)]
    json: bool,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Make these results the baseline, and remember why.
    Accept(accept::Words),
}

pub(crate) fn run(words: &Words) -> anyhow::Result<Exit> {
    match (&words.command, &words.store, &words.baseline) {
        (Some(Command::Accept(words)), ..) => accept::run(words),
        (None, Some(store), Some(baseline)) => check::run(words, store, baseline),
        _ => anyhow::bail!("a folder of results and a baseline are needed"),
    }
}

/// A probe's recipe from a file.
fn recipe(path: &Path) -> anyhow::Result<Recipe> {
    let reading = || format!("reading {}", path.display());
    let text = std::fs::read_to_string(path).with_context(reading)?;
    Recipe::from_toml(&text).with_context(reading)
}
