//! `atsplat drift`: compares results with a baseline; exits with code 3 on drift.

mod accept;
mod check;
mod github;
mod history;

use std::path::{Path, PathBuf};

use anyhow::Context as _;
use atsplat_drift::probe::Recipe;
use clap::Subcommand;

use crate::exit::Exit;
use crate::objects::CacheArgs;

#[derive(Debug, clap::Args)]
#[command(args_conflicts_with_subcommands = true, subcommand_negates_reqs = true)]
pub(crate) struct Args {
    #[command(subcommand)]
    command: Option<Command>,

    /// Folder of results, or its URL (s3://, gs://, az://).
    #[arg(required = true)]
    store: Option<PathBuf>,

    /// The baseline.
    #[arg(long, value_name = "FILE", required = true)]
    baseline: Option<PathBuf>,

    /// Recipe of the probe, in TOML, instead of the baseline's.
    #[arg(long, value_name = "FILE", conflicts_with = "no_probe")]
    probe: Option<PathBuf>,

    /// Compare only rows, without attribution to stages.
    #[arg(long)]
    no_probe: bool,

    /// Also print an annotation for GitHub Actions if something drifted, and add the report as Markdown to the summary of
    /// the step, whose file `$GITHUB_STEP_SUMMARY` names.
    #[arg(long)]
    github: bool,

    #[command(flatten)]
    history: history::HistoryArgs,

    #[command(flatten)]
    cache: CacheArgs,

    /// Print JSON.
    #[arg(long)]
    json: bool,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Make these results the baseline, and record why.
    Accept(accept::Args),
}

pub(crate) fn run(args: &Args) -> anyhow::Result<Exit> {
    match (&args.command, &args.store, &args.baseline) {
        (Some(Command::Accept(args)), ..) => accept::run(args),
        (None, Some(store), Some(baseline)) => check::run(args, store, baseline),
        _ => anyhow::bail!("expected a folder of results and --baseline"),
    }
}

/// A probe's recipe from a file.
fn recipe(path: &Path) -> anyhow::Result<Recipe> {
    let reading = || format!("reading {}", path.display());
    let text = atsplat_files::read_to_string(path).with_context(reading)?;
    Recipe::from_toml(&text).with_context(reading)
}
