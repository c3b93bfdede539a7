//! `atsplat tradeoff`: quality against time and Gaussians of each setting of a method, and which settings are worth it.

mod sweep;

use std::path::PathBuf;

use anyhow::bail;
use atsplat_results::Results;
use atsplat_results::statistics::Leaked;
use atsplat_results::tradeoff::{TradeoffReport, across, tradeoffs};
use clap::Subcommand;

use crate::exit::{Exit, WithStrict};
use crate::objects::CacheArgs;
use crate::parse::{self, once, usage_error};
use crate::print::{print_report, warn};

#[derive(Debug, clap::Args)]
#[command(args_conflicts_with_subcommands = true, subcommand_negates_reqs = true)]
pub(crate) struct Args {
    #[command(subcommand)]
    command: Option<Command>,

    /// Folder of results, or its URL (s3://, gs://, az://), in which each method is a point.
    #[arg(required = true)]
    store: Option<PathBuf>,

    /// Metric, by id; may be given several times.
    #[arg(long, value_name = "ID", default_value = "psnr", value_parser = parse::metric)]
    metric: Vec<String>,

    /// Exclude targets that methods were given as context.
    #[arg(long)]
    without_leaked: bool,

    /// Put all protocols of the folder on one frontier, although their numbers are not comparable.
    #[arg(long)]
    across: bool,

    #[command(flatten)]
    cache: CacheArgs,

    /// Print JSON.
    #[arg(long)]
    json: bool,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Run a network at every setting of a sweep, then compare the settings.
    Sweep(Box<WithStrict<sweep::Args>>),
}

/// Compares settings, running a sweep first if requested.
pub(crate) fn run(args: &Args) -> anyhow::Result<Exit> {
    let store = match (&args.command, &args.store) {
        (Some(Command::Sweep(args)), _) => return args.run(sweep::run),
        (None, Some(store)) => store,
        (None, None) => bail!("expected a folder of results"),
    };
    once("--metric", &args.metric).map_err(usage_error)?;
    let results = Results::read(&args.cache.store(store)?)?;
    let leaked = if args.without_leaked { Leaked::Excluded } else { Leaked::Included };
    let metrics: Vec<&str> = args.metric.iter().map(String::as_str).collect();
    let tradeoffs = if args.across {
        metrics.iter().map(|metric| across(&results, metric, leaked)).collect::<Result<_, _>>()?
    } else {
        tradeoffs(&results, &metrics, leaked)?
    };
    let report = TradeoffReport { tradeoffs, unfinished: results.cut_off() };
    print_report(&report, args.json)?;
    if let Some(why) = report.nothing_scored() {
        bail!("nothing was scored: {why}");
    }
    if let Some(why) = report.why_empty() {
        warn(&format!("every frontier is empty: {why}"));
    }
    Ok(Exit::Done)
}
