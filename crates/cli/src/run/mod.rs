//! `atsplat run`, `atsplat score` and `atsplat merge`: evaluate methods under protocols into a results store.

pub(crate) mod merge;
mod methods;
pub(crate) mod protocols;
pub(crate) mod score;
pub(crate) mod settings;
mod stated;
pub(crate) mod urls;

use std::path::Path;
use std::sync::Arc;

use anyhow::{Context as _, anyhow, ensure};
use atsplat_eval::EvalError;
use atsplat_eval::method::{Method, MethodSpec};
use atsplat_eval::runner::{self, Plan, Step};
use atsplat_eval::timing::TimingPlan;
use atsplat_results::{GapKind, RunReport};
use atsplat_scene::Warnings;

use crate::parse::{once, usage_error};
use crate::print::{print_report, print_status, warn};
use crate::progress::Progress;
use crate::provenance;
use crate::warnings::{
    print_absent_metrics, print_evaluated_again, print_findings, print_trial_warnings, print_unreported, print_warnings,
};
use methods::{MethodArgs, Methods};
use protocols::ProtocolArgs;
use settings::{SettingArgs, TimingArgs};

const RESUMES: &str = "the run stopped; its results so far are kept, and the same command resumes it";

// The protocols come first.
#[derive(Debug, clap::Args)]
#[command(
    mut_arg("seed", |seed| seed.help(SEED)),
    override_usage = "atsplat run <PRESET|FILE>… --data <PATH> --method <METHOD>… --out <STORE> [OPTIONS]",
    after_help = AFTER_HELP
)]
pub(crate) struct Args {
    #[command(flatten)]
    protocols: ProtocolArgs,

    /// Methods to evaluate, separated by commas; the kinds are listed below. NAME=METHOD sets the name in the results, of
    /// all but nearest-view and warp.
    #[arg(long = "method", value_name = "METHOD", required = true, value_parser = MethodSpec::list)]
    methods: Vec<Methods>,

    #[command(flatten, next_help_heading = "Methods")]
    sources: MethodArgs,

    #[command(flatten, next_help_heading = "Run")]
    settings: SettingArgs,

    #[command(flatten, next_help_heading = "Run")]
    timing: TimingArgs,
}

const SEED: &str =
    "Seed of optimisations (start, order of views, density control) and of random token selection. By default 0";

const AFTER_HELP: &str = "\
Methods:
  nearest-view, warp     Baselines
  renders:DIR, ply:DIR   Outputs of another program: images, or Gaussians
  atsplat                The network of --weights
  atsplat+refine:BUDGET, 3dgs:BUDGET, mip-splatting:BUDGET, mcmc:BUDGET
                         Optimised for each trial, from the network's Gaussians or from random
                         ones; BUDGET is a number of steps (3000) or seconds (10s)
  exec:COMMAND           A process that answers trials. It must come last: COMMAND is the rest
                         of the argument; see docs/methods.md

A store is resumed: results are not computed again, unless they lack a metric that is requested now. Failed trials become \
rows with a reason and never stop the others; --retry-failed evaluates them again.";

/// Runs methods; `true` if nothing was skipped and nothing failed.
pub(crate) fn run(args: &Args) -> anyhow::Result<bool> {
    args.protocols.check()?;
    let methods = args.methods.concat();
    args.sources.check(&methods)?;
    // Loading starts processes.
    let timing = args.timing.plan()?;
    let methods = args.sources.load(&methods)?;
    let names: Vec<String> = methods.iter().map(|method| method.record().name).collect();
    once("--method", &names).map_err(usage_error)?;
    evaluate(&args.protocols, &methods, &args.settings, timing)
}

/// Evaluates loaded methods.
fn evaluate(
    protocols: &ProtocolArgs,
    methods: &[Arc<dyn Method>],
    settings: &SettingArgs,
    timing: Option<TimingPlan>,
) -> anyhow::Result<bool> {
    protocols.check_out(settings.out())?;
    let mut warnings = Warnings::new();
    let remote = protocols.remote()?;
    let datasets = protocols.open(remote.as_ref(), &mut warnings)?;
    let suite = settings.suite(&datasets)?;
    let plan = Plan {
        datasets: &datasets,
        methods,
        suite: &suite,
        selection: settings.selection(),
        timing,
        images: settings.keep_images,
        prefetch: SettingArgs::prefetch(),
    };
    // A folder without any scene of the index is probably a typing error: `find_imported_files` fails before the run starts.
    for found in plan.find_imported_files()? {
        print_status(&found.to_string());
    }
    let record = plan.provenance(provenance())?;
    let open = |folder: &Path| Ok((settings.store(folder, record.clone())?, folder.to_owned()));
    let (out, (store, folder)) = protocols.cache().output(settings.out(), open)?;
    print_absent_metrics(&record.metrics);
    print_evaluated_again(store.known(), &record);
    let progress = Progress::new("results", usize::try_from(plan.steps()).context("too many results")?);
    let step = |step: Step<'_>| {
        progress.result(step);
        out.step();
    };
    // A failure of object storage says nothing about the data: the run stops, but an unreadable scene is skipped.
    let failure = || remote.as_ref().and_then(|remote| remote.failure()).or_else(|| out.failure());
    let outcome = runner::run_until(&plan, store, &step, &|| failure().is_some());
    drop(progress);
    if let Some(error) = failure() {
        if out.failure().is_none() {
            out.finish()?;
        }
        return Err(anyhow!(error).context(RESUMES));
    }
    let (results, summary) = match outcome {
        // The method's process does not start again, or the disk is full.
        Err(error @ EvalError::Io(_)) => {
            out.finish()?;
            return Err(anyhow!(error).context(RESUMES));
        }
        outcome => outcome?,
    };
    let results = urls::name_urls(&folder, results)?;
    out.finish()?;
    let images = protocols.images_of_expected_size(&datasets, &results);
    let report = RunReport::of(&results, Some(summary), settings.out());
    print_report(&report.with_advice(protocols.takes_any_size(), images), settings.json)?;
    if settings.json {
        print_warnings(&warnings);
        print_findings(&[&results], &warnings);
    } else {
        // The others are in the report.
        print_unreported(&warnings, &results);
        print_trial_warnings(&results);
    }
    if let Some(why) = plan.nothing_evaluated(&results) {
        ensure!(plan.is_shard_without_trials(&results), "nothing was evaluated: {why}");
        warn(&format!("nothing was evaluated: {why}"));
    }
    // A shard alone is complete; the other shards are missed where results are published.
    Ok(results.gaps().iter().all(|gap| gap.kind == GapKind::MissingShards))
}

#[cfg(test)]
mod tests {
    use atsplat_eval::method::MethodKind;

    use super::AFTER_HELP;

    #[test]
    fn the_help_lists_every_method() {
        for name in MethodKind::names() {
            assert!(AFTER_HELP.contains(name), "{name}");
        }
    }
}
