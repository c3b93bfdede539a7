//! Accuracy against time: what each way to run a method scores and takes, and which ways are worth choosing.

mod report;
mod sweep;

use std::path::PathBuf;

use atsplat_eval::Results;
use atsplat_eval::statistics::Leaked;
use atsplat_eval::tradeoff::{across, tradeoffs};
use atsplat_metrics::definition;
use clap::{Args, Subcommand};

use crate::exit::{Exit, Skipping};
use crate::output::print_report;
use report::Report;

#[derive(Debug, Args)]
#[command(args_conflicts_with_subcommands = true, subcommand_negates_reqs = true)]
pub(crate) struct Words {
    #[command(subcommand)]
    command: Option<Command>,

    /// Folder of results: each method in it is a point.
    #[arg(required = true)]
    store: Option<PathBuf>,

    /// Metric, by id; may be given several times.
    #[arg(long, value_name = "ID", default_value = "psnr", value_parser = metric)]
    metric: Vec<String>,

    /// Leave targets out that methods were given as context.
    #[arg(long)]
    without_leaked: bool,

    /// Put all protocols of the folder on one frontier, although their numbers answer different questions.
    #[arg(long)]
    across: bool,

    /// Print JSON.
    #[arg(long)]
    json: bool,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Run a network at every setting of a sweep, then say what is worth it.
    Sweep(Box<Skipping<sweep::Words>>),
}

/// Compares settings that were run, or runs them first.
pub(crate) fn run(words: &Words) -> anyhow::Result<Exit> {
    let store = match (&words.command, &words.store) {
        (Some(Command::Sweep(words)), _) => return words.run(sweep::run),
        (None, Some(store)) => store,
        (None, None) => anyhow::bail!("a folder of results is needed"),
    };
    let results = Results::read(store)?;
    let leaked = if words.without_leaked { Leaked::Excluded } else { Leaked::Included };
    let metrics: Vec<&str> = words.metric.iter().map(String::as_str).collect();
    let tradeoffs = if words.across {
        metrics.iter().map(|metric| across(&results, metric, leaked)).collect::<Result<_, _>>()?
    } else {
        tradeoffs(&results, &metrics, leaked)?
    };
    print_report(&Report { tradeoffs }, words.json)?;
    Ok(Exit::Done)
}

fn metric(word: &str) -> Result<String, String> {
    definition(word).map(|definition| definition.id.to_owned()).ok_or_else(|| {
        let known: Vec<&str> = atsplat_metrics::definitions().iter().map(|definition| definition.id).collect();
        format!("expected one of {}", known.join(", "))
    })
}
