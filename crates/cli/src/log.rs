//! What the libraries report of their work, on standard error.

use std::io::stderr;

use anyhow::Context as _;
use tracing_subscriber::filter::{LevelFilter, Targets};
use tracing_subscriber::fmt::time::uptime;
use tracing_subscriber::layer::{Layer as _, SubscriberExt as _};
use tracing_subscriber::util::SubscriberInitExt as _;

/// Events have these crates and their modules as targets.
const OWN: &str = "atsplat";

#[derive(Debug, clap::Args)]
pub(crate) struct LogArgs {
    /// Report on standard error what is read, chosen and resumed; twice for every scene and trial, three times for all.
    #[arg(long, short, global = true, action = clap::ArgAction::Count, conflicts_with = "log")]
    verbose: u8,

    /// Report these parts, as PART=LEVEL,…, e.g. `atsplat_splat=debug,atsplat_eval=info`.
    #[arg(long, global = true, value_name = "FILTER", value_parser = filter)]
    log: Option<Targets>,
}

impl LogArgs {
    /// Starts to print events, if they were requested; results and standard output stay the same.
    pub(crate) fn start(&self) -> anyhow::Result<()> {
        let level = match self.verbose {
            0 => LevelFilter::OFF,
            1 => LevelFilter::INFO,
            2 => LevelFilter::DEBUG,
            _ => LevelFilter::TRACE,
        };
        let filter = match &self.log {
            Some(filter) => filter.clone(),
            None if level == LevelFilter::OFF => return Ok(()),
            None => Targets::new().with_target(OWN, level),
        };
        let printer = tracing_subscriber::fmt::layer().with_writer(stderr).with_ansi(false).with_timer(uptime());
        tracing_subscriber::registry().with(printer.with_filter(filter)).try_init().context("starting the log")
    }
}

fn filter(text: &str) -> anyhow::Result<Targets> {
    let filter: Targets = text.parse()?;
    match filter.iter().find(|(target, _)| !target.starts_with(OWN)) {
        Some((target, _)) => anyhow::bail!("expected parts that begin with {OWN}, found {target:?}"),
        None => Ok(filter),
    }
}
