use std::path::PathBuf;

use anyhow::{Context as _, bail};
use atsplat_eval::Results;
use atsplat_eval::method::ConstantsChoice;
use atsplat_eval::runner::{self, Plan};
use atsplat_eval::statistics::Leaked;
use atsplat_eval::tradeoff::{Part, Sweep, Swept, across, parts, tradeoffs};
use atsplat_metrics::Suite;
use atsplat_model::network::Device;
use atsplat_scene::Warnings;
use clap::Args;

use super::report::Report;
use crate::machine::here;
use crate::output::{print_findings, print_report, print_warnings};
use crate::progress::Progress;
use crate::reconstruct::network::NetworkWords;
use crate::run::protocols::ProtocolWords;
use crate::run::settings::{RepetitionArgs, SettingWords};

#[derive(Debug, Args)]
pub(super) struct Words {
    #[command(flatten)]
    protocols: ProtocolWords,

    /// Settings to run at, in TOML, as those in `eval/sweeps/`.
    #[arg(long, value_name = "FILE")]
    sweep: PathBuf,

    #[command(flatten, next_help_heading = "Network")]
    network: NetworkWords,

    #[command(flatten, next_help_heading = "Run")]
    settings: SettingWords,

    #[command(flatten, next_help_heading = "Run")]
    repetitions: RepetitionArgs,
}

pub(super) fn run(words: &Words) -> anyhow::Result<bool> {
    words.network.check_for_evaluation()?;
    let reading = || format!("reading {}", words.sweep.display());
    let text = std::fs::read_to_string(&words.sweep).with_context(reading)?;
    let sweep = Sweep::from_toml(&text).with_context(reading)?;
    let swept = swept(&words.network)?;
    let mut warnings = Warnings::new();
    let datasets = words.protocols.open(&mut warnings)?;
    let suite = words.settings.suite(&datasets)?;
    let parts = parts(&sweep, &swept, &datasets)?;
    let steps = parts.iter().map(|part| plan(words, &suite, part).steps()).sum::<u64>();
    let progress = Progress::new("results", usize::try_from(steps).context("too many results")?);
    let mut complete = true;
    for part in &parts {
        let plan = plan(words, &suite, part);
        let store = words.settings.store(plan.provenance(here())?)?;
        let (results, summary) = runner::run(&plan, store, &|| progress.step())?;
        if let Some(why) = plan.nothing_evaluated(&results) {
            bail!("nothing was evaluated: {why}");
        }
        complete &= summary.is_complete();
    }
    drop(progress);
    let results = Results::read(words.settings.out())?;
    let metrics: Vec<&str> = suite.definitions().iter().map(|definition| definition.id).collect();
    let tradeoffs = match parts.len() {
        1 => tradeoffs(&results, &metrics, Leaked::Included)?,
        _ => metrics.iter().map(|metric| across(&results, metric, Leaked::Included)).collect::<Result<_, _>>()?,
    };
    print_report(&Report { tradeoffs }, words.settings.json)?;
    print_warnings(&warnings);
    print_findings(&results, &warnings);
    Ok(complete)
}

fn plan<'a>(words: &Words, suite: &'a Suite, part: &'a Part) -> Plan<'a> {
    Plan {
        datasets: &part.datasets,
        methods: &part.methods,
        suite,
        selection: words.settings.selection(),
        timing: Some(words.repetitions.plan()),
        pictures: words.settings.pictures(),
        prefetch: SettingWords::prefetch(),
    }
}

fn swept(words: &NetworkWords) -> anyhow::Result<Swept> {
    let (network, record) = words.source()?.load(&Device::flex())?;
    Ok(Swept {
        config: network.config().clone(),
        tensors: network.weights()?,
        weights: record.weights(),
        trained_at: network.trained_size(),
        call_seed: words.seed,
        constants: ConstantsChoice::OfPreset,
        background: None,
    })
}
