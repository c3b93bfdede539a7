//! The log of the libraries, on standard error.

use std::io::stderr;

use anyhow::Context as _;
use tracing_subscriber::filter::{LevelFilter, Targets};
use tracing_subscriber::fmt::time::uptime;
use tracing_subscriber::layer::{Layer as _, SubscriberExt as _};
use tracing_subscriber::util::SubscriberInitExt as _;

use crate::EVERYWHERE;

/// The targets of our events are crates with this prefix and their modules.
const CRATE_PREFIX: &str = "atsplat";

#[derive(Debug, clap::Args)]
pub(crate) struct LogArgs {
    /// Log to standard error what is read, chosen and resumed; -vv also logs every scene and trial, -vvv everything.
    #[arg(long, short, global = true, help_heading = EVERYWHERE, action = clap::ArgAction::Count, conflicts_with = "log")]
    verbose: u8,

    /// Log only these parts: PART=LEVEL,…, for example `atsplat_splat=debug,atsplat_eval=info`.
    #[arg(long, global = true, help_heading = EVERYWHERE, value_name = "FILTER", value_parser = filter)]
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
            None => Targets::new().with_target(CRATE_PREFIX, level),
        };
        let printer = tracing_subscriber::fmt::layer().with_writer(stderr).with_ansi(false).with_timer(uptime());
        tracing_subscriber::registry().with(printer.with_filter(filter)).try_init().context("starting the log")
    }
}

/// Whether `-v` or a filter has the log name single scenes and files.
pub(crate) fn is_on() -> bool {
    LevelFilter::current() >= LevelFilter::INFO
}

fn filter(text: &str) -> anyhow::Result<Targets> {
    let filter: Targets = text.parse()?;
    match filter.iter().find(|(target, _)| !target.starts_with(CRATE_PREFIX)) {
        Some((target, _)) => anyhow::bail!("expected parts that begin with {CRATE_PREFIX}, found {target:?}"),
        None => Ok(filter),
    }
}
