//! `atsplat expansion`: Adaptive Token Expansion over a protocol.

use std::path::PathBuf;

use anyhow::{Context as _, bail};
use atsplat_eval::expansion::{ExpansionReport, measure_trial};
use atsplat_eval::runner::{Dataset, MISSING_SCENES, Selection};
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

/// Warns of scenes of the index that the data lack, as `atsplat run` does; `true` if there are none.
fn has_all_scenes(dataset: &Dataset, selection: Selection) -> bool {
    let missing = selection.missing_in(dataset);
    let Some(first) = missing.first() else { return true };
    warn(&format!("{}: {} × {MISSING_SCENES}\n    {first}", dataset.name, missing.len()));
    false
}

/// Measures a network under each protocol; `true` if no scene was missing and no trial skipped.
pub(crate) fn run(args: &Args) -> anyhow::Result<bool> {
    let trained = embedded::trained(args.weights.as_deref())?;
    let config = args.changes.applied(&trained.config)?;
    let network = trained.network_for(&config)?;
    let mut warnings = Warnings::new();
    let (mut complete, mut reports) = (true, Vec::new());
    let remote = args.protocols.remote()?;
    for dataset in args.protocols.open(remote.as_ref(), &mut warnings)? {
        let selection = Selection { limit: args.limit, shard: None };
        complete &= has_all_scenes(&dataset, selection);
        let index = selection.index_of(&dataset);
        let trials = dataset.trials(&index);
        let progress = Progress::new("trials", trials.size_hint().0);
        let mut measurements = Vec::new();
        for outcome in trials {
            match outcome {
                Ok((trial, truths)) => {
                    let measured = measure_trial(&network, (&trial, &truths), dataset.render_options(&trial), 0);
                    measurements.push(measured.with_context(|| format!("scene {}", trial.scene()))?);
                }
                Err(skipped) => {
                    warn(&skipped.to_string());
                    complete = false;
                }
            }
            progress.step();
        }
        drop(progress);
        RemoteData::check(remote.as_ref())?;
        if measurements.is_empty() {
            bail!("{}: none of its trials can be read", dataset.name);
        }
        let report = ExpansionReport::new(&config.name, &dataset.name, &measurements);
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
    print_warnings(&warnings);
    Ok(complete)
}
