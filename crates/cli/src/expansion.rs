//! `atsplat expansion`: Adaptive Token Expansion over a protocol.

use std::path::PathBuf;

use anyhow::bail;
use atsplat_eval::expansion::{ExpansionGap, ExpansionReport, TrialMeasurement, measure_trial};
use atsplat_eval::runner::{Dataset, Selection};
use atsplat_model::network::Network;
use atsplat_scene::Warnings;

use crate::embedded;
use crate::model_args::ConfigOverrideArgs;
use crate::objects::check_reading;
use crate::print::{print_json, print_report, warn};
use crate::progress::Progress;
use crate::run::protocols::ProtocolArgs;
use crate::warnings::print_warnings;

/// Label of random weights in every plot of their expansion.
pub(crate) const UNTRAINED: &str = "UNTRAINED, random weights";
/// The kind of the gap of trials whose images are damaged, or which the network rejects.
const NOT_MEASURED: &str = "trials that could not be measured";

#[derive(Debug, clap::Args)]
#[command(override_usage = "atsplat expansion <PRESET|FILE>… --data <PATH> [OPTIONS]")]
pub(crate) struct Args {
    #[command(flatten)]
    protocols: ProtocolArgs,

    /// Weights with their configuration; by default micro-rooms, or micro-yards for protocols on yards and DL3DV, which are
    /// embedded in the binary.
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
    args.protocols.check()?;
    let given = args.weights.as_deref().map(|file| embedded::trained(Some(file))).transpose()?;
    let (mut complete, mut reports) = (true, Vec::new());
    let remote = args.protocols.remote()?;
    let selection = Selection { limit: args.limit, shard: None };
    for dataset in args.protocols.open(remote.as_ref(), warnings)? {
        let by_default;
        let trained = if let Some(given) = &given {
            given
        } else {
            by_default = embedded::for_protocol(&dataset.preset)?;
            &by_default
        };
        let config = args.changes.applied(&trained.config)?;
        let network = trained.network_for(&config)?;
        let (trials, gaps) = trials_of(&network, &dataset, selection, warnings);
        check_reading()?;
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

/// Measures the trials of a dataset, and warns of what is missing from them, as `atsplat run` does. One that cannot be measured is
/// missing too.
fn trials_of(
    network: &Network,
    dataset: &Dataset,
    selection: Selection,
    warnings: &mut Warnings,
) -> (Vec<TrialMeasurement>, Vec<ExpansionGap>) {
    let mut gaps = ExpansionGap::of_dataset(dataset, selection);
    for ExpansionGap { kind, count, first } in &gaps {
        warn(&format!("{}: {count} × {kind}\n    {first}", dataset.name));
    }
    let mut trials = dataset.trials(&selection.index_of(dataset));
    let progress = Progress::new("trials", trials.size_hint().0);
    let (mut measurements, mut failures) = (Vec::new(), Vec::new());
    for outcome in &mut trials {
        match outcome {
            Ok((trial, truths)) => match measure_trial(network, (&trial, &truths), dataset.render_options(&trial), 0) {
                Ok(measured) => measurements.push(measured),
                Err(error) => {
                    let failure = format!("scene {}, entry {}: {error}", trial.scene(), trial.entry_number());
                    warn(&format!("{}: not measured: {failure}", dataset.name));
                    failures.push(failure);
                }
            },
            Err(skipped) => warn(&skipped.to_string()),
        }
        progress.step();
    }
    gaps.extend(ExpansionGap::of_skipped(&trials.report().skipped));
    gaps.extend(failures.first().map(|first| ExpansionGap {
        kind: NOT_MEASURED.to_owned(),
        count: failures.len() as u64,
        first: first.clone(),
    }));
    // A sampler has read the same scenes before.
    warnings.join(trials.warnings());
    (measurements, gaps)
}

fn why_none(dataset: &Dataset, gaps: &[ExpansionGap]) -> String {
    if gaps.is_empty() {
        return format!("the index has no entry ({})", dataset.index.description);
    }
    gaps.iter().map(ToString::to_string).collect::<Vec<_>>().join("; ")
}
