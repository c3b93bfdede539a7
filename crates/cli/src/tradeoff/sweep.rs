use std::path::PathBuf;

use anyhow::Context as _;
use atsplat_eval::method::ConstantsChoice;
use atsplat_eval::runner::{self, Plan};
use atsplat_eval::statistics::Leaked;
use atsplat_eval::tradeoff::{Part, Sweep, Swept, across, parts, tradeoffs};
use atsplat_eval::{Results, Store};
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
use crate::run::settings::SettingWords;

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
}

pub(super) fn run(words: &Words) -> anyhow::Result<bool> {
    let reading = || format!("reading {}", words.sweep.display());
    let text = std::fs::read_to_string(&words.sweep).with_context(reading)?;
    let sweep = Sweep::from_toml(&text).with_context(reading)?;
    let swept = swept(&words.network)?;
    let mut warnings = Warnings::new();
    let datasets = words.protocols.open(&mut warnings)?;
    let suite = words.settings.suite(&datasets)?;
    let parts = parts(&sweep, &swept, &datasets)?;
    let steps = parts.iter().map(|part| plan(words, &suite, part).results()).sum::<u64>();
    let progress = Progress::new("results", usize::try_from(steps).context("too many results")?);
    let mut complete = true;
    for part in &parts {
        let plan = plan(words, &suite, part);
        let store = Store::resume(words.settings.out(), plan.provenance(here())?)?;
        let (_, summary) = runner::run(&plan, store, &|| progress.step())?;
        complete &= summary.is_complete();
    }
    drop(progress);
    let results = Results::read(words.settings.out())?;
    let metrics: Vec<&str> = suite.definitions().iter().map(|definition| definition.id).collect();
    let tradeoffs = match parts.len() {
        1 => tradeoffs(&results, &metrics, Leaked::Included),
        _ => metrics.iter().map(|metric| across(&results, metric, Leaked::Included)).collect(),
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
        repetitions: words.settings.repetitions(),
        alone: words.settings.alone(),
        pictures: words.settings.pictures(),
        prefetch: SettingWords::prefetch(),
    }
}

fn swept(words: &NetworkWords) -> anyhow::Result<Swept> {
    words.check().map_err(anyhow::Error::msg)?;
    let (network, record) = words.source()?.load(&Device::flex())?;
    Ok(Swept {
        config: network.config().clone(),
        tensors: network.weights()?,
        weights: record.weights(),
        call_seed: words.seed,
        constants: ConstantsChoice::OfPreset,
        background: None,
    })
}
