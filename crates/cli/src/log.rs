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

/// The crates whose events are printed, after the prefix and `_`.
const CRATES: [&str; 21] = [
    "camera", "drift", "eval", "files", "fit", "metrics", "model", "nn", "numeric", "objects", "opencv", "pickle",
    "pixels", "protocol", "report", "results", "rooms", "scene", "splat", "tensors", "train",
];

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
    match filter.iter().find(|(target, _)| !is_part(target)) {
        Some((target, _)) => {
            let crates = CRATES.join(", ");
            anyhow::bail!("expected parts that begin with {CRATE_PREFIX}_ and one of {crates}, found {target:?}")
        }
        None => Ok(filter),
    }
}

/// Whether a target is that of events, or the beginning of one: of a crate, or of a module in it.
fn is_part(target: &str) -> bool {
    let is_of = |name: &str| {
        name.starts_with(target) || target.strip_prefix(name).is_some_and(|module| module.starts_with("::"))
    };
    let is_of_crate = || CRATES.iter().any(|name| is_of(&format!("{CRATE_PREFIX}_{name}")));
    target.starts_with(CRATE_PREFIX) && (is_of(CRATE_PREFIX) || is_of_crate())
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;

    #[test]
    fn parts_are_crates_of_this_workspace_and_their_modules() {
        let crates = Path::new(env!("CARGO_MANIFEST_DIR")).parent().unwrap();
        for name in CRATES {
            assert!(crates.join(name).join("src").is_dir(), "{name}");
        }
        for entry in std::fs::read_dir(crates).unwrap() {
            let name = entry.unwrap().file_name().into_string().unwrap();
            let is_apart = name == "cli" || name == "python" || !crates.join(&name).join("src").is_dir();
            assert!(is_apart || CRATES.contains(&name.as_str()), "{name}");
        }
        for part in ["atsplat", "atsplat::run", "atsplat_s", "atsplat_scene", "atsplat_scene::open"] {
            assert!(is_part(part), "{part}");
        }
        for other in ["", "ats", "scene", "atsplat_scenes", "atsplat_scene:open", "atsplat_evl", "wgpu"] {
            assert!(!is_part(other), "{other}");
        }
    }
}
