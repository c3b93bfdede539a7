//! `atsplat run`, `atsplat score` and `atsplat merge`: methods on protocols into a results store.

pub(crate) mod merge;
mod methods;
pub(crate) mod protocols;
mod report;
pub(crate) mod score;
pub(crate) mod settings;

use std::path::PathBuf;

use anyhow::{Context as _, bail};
use atsplat_eval::Results;
use atsplat_eval::method::Method;
use atsplat_eval::runner::{self, Plan};
use atsplat_scene::Warnings;
use clap::Args;

use crate::machine::here;
use crate::output::{complain, print_findings, print_report, print_warnings};
use crate::progress::Progress;
use methods::{MethodWord, MethodWords};
use protocols::ProtocolWords;
use report::Report;
use settings::{SettingWords, TimingArgs};

// The protocols come first.
#[derive(Debug, Args)]
#[command(
    override_usage = "atsplat run <PRESET|FILE>… --data <PATH> --method <METHOD>… --out <STORE> [OPTIONS]",
    after_help = "A store that was left unfinished, by a crash or on purpose, is gone on with: what is in it is not computed \
                  again. Trials that fail are rows with a reason, and never stop the others."
)]
pub(crate) struct Words {
    #[command(flatten)]
    protocols: ProtocolWords,

    /// What answers: atsplat, nearest-view, warp, renders:DIR (pictures by any other method), ply:DIR (its Gaussians), each
    /// as NAME=METHOD too to call it so in the results.
    #[arg(long = "method", value_name = "METHOD", required = true, value_delimiter = ',')]
    methods: Vec<MethodWord>,

    #[command(flatten, next_help_heading = "Methods")]
    sources: MethodWords,

    #[command(flatten, next_help_heading = "Run")]
    settings: SettingWords,

    #[command(flatten, next_help_heading = "Run")]
    timing: TimingArgs,
}

/// Runs methods; `true` where nothing was skipped and nothing failed.
pub(crate) fn run(words: &Words) -> anyhow::Result<bool> {
    words.sources.check()?;
    let methods = words.sources.methods(&words.methods)?;
    evaluate(&words.protocols, &methods, &words.settings, words.timing)
}

/// Runs methods that are ready.
fn evaluate(
    protocols: &ProtocolWords,
    methods: &[std::sync::Arc<dyn Method>],
    settings: &SettingWords,
    timing: TimingArgs,
) -> anyhow::Result<bool> {
    let timing = timing.plan()?;
    let mut warnings = Warnings::new();
    let datasets = protocols.open(&mut warnings)?;
    let suite = settings.suite(&datasets)?;
    let plan = Plan {
        datasets: &datasets,
        methods,
        suite: &suite,
        selection: settings.selection(),
        timing,
        pictures: settings.pictures(),
        prefetch: SettingWords::prefetch(),
    };
    // A folder without a single scene is a mistyped one: nothing is begun.
    for survey in plan.surveys()? {
        complain(&survey.to_string());
    }
    let store = settings.store(plan.provenance(here())?)?;
    let progress = Progress::new("results", usize::try_from(plan.steps()).context("too many results")?);
    let (results, summary) = runner::run(&plan, store, &|| progress.step())?;
    drop(progress);
    let takes_any_size = protocols.takes_any_size();
    print_report(&Report::of(&results, Some(summary), settings.out()).advising(takes_any_size), settings.json)?;
    print_warnings(&warnings);
    print_findings(&results, &warnings);
    if let Some(why) = plan.nothing_evaluated(&results) {
        bail!("nothing was evaluated: {why}");
    }
    Ok(summary.is_complete())
}

/// Reads stores that a command was given.
fn read(stores: &[PathBuf]) -> anyhow::Result<Vec<Results>> {
    let read = |path: &PathBuf| Results::read(path).with_context(|| format!("reading {}", path.display()));
    stores.iter().map(read).collect()
}
