//! The `atsplat` command line: parses arguments and calls the library crates.
//!
//! Exit codes: 0 done, 1 failed, 2 usage error, 3 drift found, 4 done, but not complete: something was skipped or failed (`--strict` only).

mod adapter_self_test;
mod adapters;
mod alpha;
mod arguments;
mod budget;
mod data;
mod dataset_args;
mod device;
mod drift;
mod embedded;
mod exit;
mod expansion;
mod fit;
mod log;
mod model_args;
mod objects;
mod output_lock;
mod overwrite;
mod parse;
mod paths;
mod plot;
mod print;
mod progress;
mod protocol;
mod reconstruct;
mod render;
mod report;
mod reproduce;
mod requirements;
mod run;
mod shell;
mod stress;
mod tradeoff;
mod train;
mod warnings;
mod weights;

use std::ffi::OsString;
use std::path::Path;
use std::process::ExitCode;

use anyhow::Context as _;
use atsplat_results::Provenance;
use clap::{Parser, Subcommand};

use crate::exit::{Exit, WithStrict};

#[global_allocator]
static ALLOCATOR: mimalloc::MiMalloc = mimalloc::MiMalloc;

/// The commit of this program, or a hash of its sources.
const COMMIT: Option<&str> = option_env!("ATSPLAT_COMMIT");

/// The environment variable by which rayon chooses the number of threads.
const STATED_THREADS: &str = "RAYON_NUM_THREADS";

/// The heading of options that every command has.
const EVERYWHERE: &str = "Every command";

const REPORT_STRICT: &str = "Exit with code 4 if a store is incomplete (shards or scenes are missing, entries were \
                             skipped, trials failed, renders are not finite, the run was interrupted) or a table of \
                             --tables has no results";

const REPRODUCE_STRICT: &str = "Exit with code 4 if the results are incomplete: scenes are missing, entries were \
                                skipped, a trial failed or rendered no Gaussian, data below --data do not fit a \
                                protocol, or a film or plot of expansion could not be made. Protocols that a list of \
                                --weights leaves out do not count";

const RENDER_STRICT: &str = "Exit with code 4 if a frame could not be written or rendered no Gaussian";

/// Evaluates feed-forward 3D Gaussian Splatting, from a dataset's bytes to a paper's table.
#[derive(Debug, Parser)]
#[command(name = "atsplat", version, propagate_version = true)]
struct Cli {
    /// Number of worker threads, which does not affect results; 0 takes `RAYON_NUM_THREADS` or, without it, one per logical
    /// processor.
    #[arg(long, global = true, help_heading = EVERYWHERE, default_value_t = 0, value_name = "N", value_parser = clap::value_parser!(u16).range(..=512))]
    threads: u16,

    #[command(flatten)]
    log: log::LogArgs,

    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Run everything that can run here and write the full report: every table and plot, measured next to published
    /// numbers.
    #[command(mut_arg("strict", |strict| strict.help(REPRODUCE_STRICT)))]
    Reproduce(WithStrict<reproduce::Args>),
    /// Inspect, convert, simulate and undistort datasets.
    #[command(subcommand)]
    Data(data::Command),
    /// List, lint, build and derive evaluation protocols.
    #[command(subcommand)]
    Protocol(protocol::Command),
    /// Run methods on protocols into a results store; an interrupted run resumes.
    Run(Box<WithStrict<run::Args>>),
    /// Score images or Gaussians of any other method under a protocol.
    Score(Box<WithStrict<run::score::Args>>),
    /// Merge the shards of a run.
    Merge(WithStrict<run::merge::Args>),
    /// Compare results with the paper: tables, plots and one HTML page.
    #[command(mut_arg("strict", |strict| strict.help(REPORT_STRICT)))]
    Report(WithStrict<report::Args>),
    /// Reconstruct Gaussians from posed photos.
    Reconstruct(Box<reconstruct::Args>),
    /// Optimise Gaussians for one scene: 3DGS, Mip-Splatting, MCMC, or the refinement of a network's Gaussians.
    Fit(Box<fit::Args>),
    /// Render Gaussians along a camera path into PNG, EXR and an animation.
    #[command(mut_arg("strict", |strict| strict.help(RENDER_STRICT)))]
    Render(Box<WithStrict<render::Args>>),
    /// Print the numbers of tokens and Gaussians of each setting of the paper, next to the published figures.
    Budget(budget::Args),
    /// Import, export, inspect and verify weights.
    #[command(subcommand)]
    Weights(weights::Command),
    /// Compare results with a baseline: which numbers moved, and which stage moved them; exits with 3 if any did.
    Drift(drift::Args),
    /// Show which settings of a method are worth their time and their Gaussians.
    Tradeoff(tradeoff::Args),
    /// Measure what token expansion does over a protocol: whether predicted uncertainty ranks errors, and how far
    /// children are placed from their parents.
    Expansion(Box<WithStrict<expansion::Args>>),
    /// List and test graphics adapters.
    Adapters(adapters::Args),
    /// Train a network from a configuration; a run can be killed at any moment and resumed with identical results.
    Train(train::Args),
    /// Run every renderer on the hard cases; exits with 1 if one fails.
    Stress(stress::Args),
    /// Print the completion script of a shell.
    Completions(shell::CompletionsArgs),
    /// Print the manual page, or write one per command.
    Man(shell::ManArgs),
}

fn main() -> ExitCode {
    let cli = match arguments::parse(std::env::args_os()) {
        Ok(cli) => cli,
        Err(error) => return arguments::print(&error),
    };
    match run(&cli).and_then(|exit| objects::check_reading().map(|()| exit)) {
        Ok(exit) => exit.into(),
        Err(error) if error.is::<clap::Error>() => {
            print::print_status(&error.to_string());
            Exit::UsageError.into()
        }
        Err(error) => {
            print::print_status(&format!("error: {}", chain_text(&error)));
            ExitCode::FAILURE
        }
    }
}

/// The error and its causes, without causes whose text an outer error already quotes.
fn chain_text(error: &anyhow::Error) -> String {
    let mut text = error.to_string();
    for cause in error.chain().skip(1).map(ToString::to_string) {
        if !text.contains(&cause) {
            text.push_str(": ");
            text.push_str(&cause);
        }
    }
    text
}

const fn exit_of_check(passed: bool) -> Exit {
    if passed { Exit::Done } else { Exit::Failed }
}

/// Rejects a number of threads that rayon would ignore.
fn check_stated_threads(stated: Option<OsString>) -> Result<(), clap::Error> {
    let stated = stated.unwrap_or_default();
    if stated.is_empty() || stated.to_str().is_some_and(|text| text.parse::<usize>().is_ok()) {
        return Ok(());
    }
    let found = stated.display();
    Err(parse::usage_error(format!(
        "{STATED_THREADS}: expected a number of threads, found {found}: correct or unset it, or give --threads"
    )))
}

fn run(cli: &Cli) -> anyhow::Result<Exit> {
    cli.log.start()?;
    if cli.threads == 0 {
        check_stated_threads(std::env::var_os(STATED_THREADS))?;
    }
    rayon::ThreadPoolBuilder::new()
        .num_threads(cli.threads.into())
        .build_global()
        .context("starting worker threads")?;
    match &cli.command {
        Command::Reproduce(args) => args.run(reproduce::run),
        Command::Data(command) => data::run(command),
        Command::Protocol(command) => protocol::run(command),
        Command::Render(args) => args.run(render::run),
        Command::Run(args) => args.run(run::run),
        Command::Score(args) => args.run(run::score::run),
        Command::Merge(args) => args.run(run::merge::run),
        Command::Report(args) => args.run(report::run),
        Command::Reconstruct(args) => reconstruct::run(args).map(|()| Exit::Done),
        Command::Fit(args) => fit::run(args).map(|()| Exit::Done),
        Command::Weights(command) => weights::run(command).map(|()| Exit::Done),
        Command::Adapters(args) => adapters::run(args).map(|()| Exit::Done),
        Command::Drift(args) => drift::run(args),
        Command::Tradeoff(args) => tradeoff::run(args),
        Command::Expansion(args) => args.run(expansion::run),
        Command::Budget(args) => Ok(exit_of_check(budget::run(args)?)),
        Command::Train(args) => train::run(args).map(|()| Exit::Done),
        Command::Stress(args) => Ok(exit_of_check(stress::run(args)?)),
        Command::Completions(args) => shell::completions(args).map(|()| Exit::Done),
        Command::Man(args) => shell::man(args).map(|()| Exit::Done),
    }
}

/// Provenance of a run of this process. The folder of the binary is left out, because results are published.
fn provenance() -> Provenance {
    let mut command: Vec<String> = std::env::args_os().map(|arg| arg.to_string_lossy().into_owned()).collect();
    if let Some(binary) = command.first_mut() {
        let name = Path::new(binary).file_name().map(|name| name.to_string_lossy().into_owned());
        *binary = name.unwrap_or_else(|| "atsplat".to_owned());
    }
    atsplat_eval::runner::current_provenance(env!("CARGO_PKG_VERSION"), COMMIT, command)
}
