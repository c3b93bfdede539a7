use std::path::PathBuf;

use anyhow::{Context as _, bail};
use atsplat_eval::ComputeDevice;
use atsplat_eval::method::ConstantsChoice;
use atsplat_eval::runner::{self, Plan};
use atsplat_eval::sweep::{Overrides, Part, Sweep, SweepBase, SweepNetwork, parts};
use atsplat_metrics::Suite;
use atsplat_results::statistics::Leaked;
use atsplat_results::tradeoff::{TradeoffReport, across, tradeoffs};
use atsplat_results::{GapKind, Results};
use atsplat_scene::Warnings;

use crate::objects::check_reading;
use crate::parse::usage_error;
use crate::print::{note, print_report, warn};
use crate::progress::Progress;
use crate::provenance;
use crate::reconstruct::network::NetworkArgs;
use crate::requirements::{Requirement, check_all};
use crate::run::protocols::ProtocolArgs;
use crate::run::settings::{RepetitionArgs, SettingArgs};
use crate::run::urls::name_urls;
use crate::warnings::{print_absent_metrics, print_evaluated_again, print_findings, print_warnings};

#[derive(Debug, clap::Args)]
#[command(mut_arg("out", |out| out.help("Folder of the results; an unfinished run in it is resumed")))]
pub(super) struct Args {
    #[command(flatten)]
    protocols: ProtocolArgs,

    /// Settings of the sweep, in TOML, as in `eval/sweeps/`.
    #[arg(long, value_name = "FILE")]
    sweep: PathBuf,

    #[command(flatten, next_help_heading = "Network")]
    network: NetworkArgs,

    #[command(flatten, next_help_heading = "Run")]
    settings: SettingArgs,

    #[command(flatten, next_help_heading = "Run")]
    repetitions: RepetitionArgs,
}

pub(super) fn run(args: &Args) -> anyhow::Result<bool> {
    args.protocols.check()?;
    args.network.check().map_err(usage_error)?;
    args.protocols.check_out(args.settings.out())?;
    let reading = || format!("reading {}", args.sweep.display());
    let text = atsplat_files::read_to_string(&args.sweep).with_context(reading)?;
    let sweep = Sweep::from_toml(&text).with_context(reading)?;
    check_network_options(&args.network, &sweep)?;
    let base = sweep_base(&args.network, &sweep)?;
    let mut warnings = Warnings::new();
    let remote = args.protocols.remote()?;
    let datasets = args.protocols.open(remote.as_ref(), &mut warnings)?;
    let suite = args.settings.suite(&datasets)?;
    let parts = parts(&sweep, &base, &datasets)?;
    let plans: Vec<Plan<'_>> = parts.iter().map(|part| plan(args, &suite, part)).collect();
    let steps = plans.iter().map(Plan::steps).sum::<u64>();
    // Of all parts: a sweep that is killed lacks those that it has not reached, and what is rejected is rejected at once.
    let record = Plan::joint_provenance(&plans, &provenance())?;
    print_evaluated_again(args.settings.store(args.settings.out(), record.clone())?.known(), &record);
    print_absent_metrics(&record.metrics);
    let progress = Progress::new("results", usize::try_from(steps).context("too many results")?);
    let (mut empty_parts, mut is_empty_shard) = (Vec::new(), true);
    for plan in &plans {
        let store = args.settings.store(args.settings.out(), plan.provenance(provenance())?)?;
        let (results, _) = runner::run(plan, store, &|step| progress.result(step))?;
        check_reading()?;
        let results = name_urls(args.settings.out(), results)?;
        is_empty_shard &= plan.is_shard_without_trials(&results);
        if let Some(why) = plan.nothing_evaluated(&results) {
            let labels: Vec<String> = plan.methods.iter().map(|method| method.record().name).collect();
            empty_parts.push(format!("{}: nothing was evaluated: {why}", labels.join(", ")));
        }
    }
    drop(progress);
    let results = Results::read(args.settings.out())?;
    let metrics: Vec<&str> = suite.definitions().iter().map(|definition| definition.id).collect();
    let tradeoffs = match plans.len() {
        1 => tradeoffs(&results, &metrics, Leaked::Included)?,
        _ => metrics.iter().map(|metric| across(&results, metric, Leaked::Included)).collect::<Result<_, _>>()?,
    };
    let report = TradeoffReport { tradeoffs, unfinished: results.cut_off() };
    print_report(&report, args.settings.json)?;
    print_warnings(&warnings);
    print_findings(&[&results], &warnings);
    // Settings without a trial are in no table.
    let all_empty = empty_parts.len() == plans.len();
    let nothing = all_empty.then(|| empty_parts.join("; ")).or_else(|| report.nothing_scored());
    if let Some(why) = nothing.filter(|_| !is_empty_shard) {
        bail!("no setting has a result: {why}");
    }
    for why in &empty_parts {
        warn(why);
    }
    // A shard alone is complete, as for `run`.
    Ok(results.gaps().iter().all(|gap| gap.kind == GapKind::MissingShards))
}

fn plan<'a>(args: &Args, suite: &'a Suite, part: &'a Part) -> Plan<'a> {
    Plan {
        datasets: &part.datasets,
        methods: &part.methods,
        suite,
        selection: args.settings.selection(),
        timing: Some(args.repetitions.plan()),
        images: args.settings.keep_images,
        prefetch: SettingArgs::prefetch(),
    }
}

/// What the settings that run a network override.
fn of_networks(sweep: &Sweep) -> impl Iterator<Item = &Overrides> {
    sweep.settings.iter().map(|setting| &setting.overrides).filter(|overrides| overrides.runs_network())
}

/// Rejects options of the network if no setting runs one, and reports those that all of these settings override.
fn check_network_options(args: &NetworkArgs, sweep: &Sweep) -> Result<(), clap::Error> {
    let options = args.options();
    let checked = check_all(&[Requirement {
        options: &options,
        requires: "a setting of --sweep without `strategy`: the others run no network",
        satisfied: of_networks(sweep).next().is_some(),
    }]);
    checked.map_err(usage_error)?;
    let selects = |own: &Overrides| own.thresholds.is_some() || own.ratios.is_some();
    for (option, _) in options.into_iter().filter(|(_, given)| *given) {
        let overrides = |own: &Overrides| match option {
            "--thresholds" | "--ratios" => selects(own),
            "--expand-first" => own.expand_first.is_some(),
            "--weights" => own.weights.is_some(),
            _ => false,
        };
        if of_networks(sweep).all(overrides) {
            note(&format!("{option} has no effect: every setting that runs a network has its own"));
        }
    }
    Ok(())
}

fn sweep_base(args: &NetworkArgs, sweep: &Sweep) -> anyhow::Result<SweepBase> {
    let runs_network = of_networks(sweep).next().is_some();
    let device = if runs_network { args.device.open_for_networks()? } else { args.device.open()? };
    Ok(SweepBase {
        network: runs_network.then(|| sweep_network(args, &device)).transpose()?,
        changes: args.changes().overrides(),
        sees_as_given: args.sees_as_given(),
        call_seed: args.call_seed(),
        constants: ConstantsChoice::FromPreset,
        background: None,
        device,
    })
}

fn sweep_network(args: &NetworkArgs, device: &ComputeDevice) -> anyhow::Result<SweepNetwork> {
    let source = args.source()?;
    let (network, record) = source.load(&device.network()?)?;
    Ok(SweepNetwork {
        config: network.config().clone(),
        high_resolution: source.high_resolution().cloned(),
        tensors: network.weights()?,
        weights: record.weights(),
        training: record.training(),
        trained_under: record.trained_under(),
        trained_at: network.trained_size(),
    })
}
