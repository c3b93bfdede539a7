//! `atsplat expansion`: Adaptive Token Expansion over a protocol.

use std::path::PathBuf;

use anyhow::{Context as _, bail};
use atsplat_eval::expansion::{ExpansionGap, ExpansionReport, TrialMeasurement, measure_trial};
use atsplat_eval::runner::{Dataset, Selection};
use atsplat_model::network::Network;
use atsplat_scene::Warnings;

use crate::embedded;
use crate::model_args::ConfigOverrideArgs;
use crate::objects::RemoteData;
use crate::print::{print_json, print_report, warn};
use crate::progress::Progress;
use crate::run::protocols::ProtocolArgs;
use crate::warnings::print_warnings;

/// Label of random weights in every plot of their expansion.
pub(crate) const UNTRAINED: &str = "UNTRAINED, random weights";

#[derive(Debug, clap::Args)]
#[command(override_usage = "atsplat expansion <PRESET|FILE>… --data <PATH> [OPTIONS]")]
pub(crate) struct Args {
    #[command(flatten)]
    protocols: ProtocolArgs,

    /// Weights with their configuration; by default micro-rooms, which is embedded in the binary.
    #[arg(long, value_name = "FILE")]
    weights: Option<PathBuf>,

    #[command(flatten)]
    changes: ConfigOverrideArgs,

    /// Only N scenes of each dataset, spread evenly over the index.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..))]
    limit: Option<u64>,

    /// Print JSON; for several protocols, an array.
    #[arg(long)]
    json: bool,
}

/// Measures a network under each protocol; `true` if nothing is missing: no scene, no trial, nothing that a sampler left out.
pub(crate) fn run(args: &Args) -> anyhow::Result<bool> {
    let mut warnings = Warnings::new();
    let outcome = measure(args, &mut warnings);
    // Also after an error, whose cause they may tell.
    print_warnings(&warnings);
    outcome
}

fn measure(args: &Args, warnings: &mut Warnings) -> anyhow::Result<bool> {
    let trained = embedded::trained(args.weights.as_deref())?;
    let config = args.changes.applied(&trained.config)?;
    let network = trained.network_for(&config)?;
    let (mut complete, mut reports) = (true, Vec::new());
    let remote = args.protocols.remote()?;
    let selection = Selection { limit: args.limit, shard: None };
    for dataset in args.protocols.open(remote.as_ref(), warnings)? {
        let (trials, gaps) = trials_of(&network, &dataset, selection, warnings)?;
        RemoteData::check(remote.as_ref())?;
        if trials.is_empty() {
            bail!("{}: none of its trials can be read: {}", dataset.name, why_none(&dataset, &gaps));
        }
        complete &= gaps.is_empty();
        let report = ExpansionReport::new(&config.name, &dataset.name, &trials, gaps);
        if args.json {
            reports.push(report);
        } else {
            print_report(&report, false)?;
        }
    }
    match reports.as_slice() {
        [] => {}
        [only] => print_json(only)?,
        several => print_json(several)?,
    }
    Ok(complete)
}

/// Measures the trials of a dataset, and warns of what is missing from them, as `atsplat run` does.
fn trials_of(
    network: &Network,
    dataset: &Dataset,
    selection: Selection,
    warnings: &mut Warnings,
) -> anyhow::Result<(Vec<TrialMeasurement>, Vec<ExpansionGap>)> {
    let mut gaps = ExpansionGap::of_dataset(dataset, selection);
    for ExpansionGap { kind, count, first } in &gaps {
        warn(&format!("{}: {count} × {kind}\n    {first}", dataset.name));
    }
    let mut trials = dataset.trials(&selection.index_of(dataset));
    let progress = Progress::new("trials", trials.size_hint().0);
    let mut measurements = Vec::new();
    for outcome in &mut trials {
        match outcome {
            Ok((trial, truths)) => {
                let measured = measure_trial(network, (&trial, &truths), dataset.render_options(&trial), 0);
                measurements.push(measured.with_context(|| format!("scene {}", trial.scene()))?);
            }
            Err(skipped) => warn(&skipped.to_string()),
        }
        progress.step();
    }
    gaps.extend(ExpansionGap::of_skipped(&trials.report().skipped));
    // A sampler has read the same scenes before.
    warnings.join(trials.warnings());
    Ok((measurements, gaps))
}

fn why_none(dataset: &Dataset, gaps: &[ExpansionGap]) -> String {
    if gaps.is_empty() {
        return format!("the index has no entry ({})", dataset.index.description);
    }
    gaps.iter().map(ToString::to_string).collect::<Vec<_>>().join("; ")
}
