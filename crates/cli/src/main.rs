//! The `atsplat` command line: words into calls of the library crates.
//!
//! Exit codes: 0 done, 1 failed, 2 wrong words, 3 drift found, 4 done with scenes or frames skipped (`--strict` only).

mod adapter_tests;
mod adapters;
mod budget;
mod carried;
mod data;
mod dataset_words;
mod drift;
mod exit;
mod expansion;
mod machine;
mod memory;
mod model_words;
mod output;
mod plot;
mod progress;
mod protocol;
mod reconstruct;
mod render;
mod report;
mod reproduce;
mod run;
mod selection;
mod stress;
mod tradeoff;
mod train;
mod weights;
mod words;

use std::process::ExitCode;

use anyhow::Context as _;
use clap::{Parser, Subcommand};

use crate::exit::{Exit, Skipping, done};

#[global_allocator]
static ALLOCATOR: mimalloc::MiMalloc = mimalloc::MiMalloc;

/// Evaluates feed-forward 3D Gaussian splatting: scenes, protocols, trials.
#[derive(Debug, Parser)]
#[command(name = "atsplat", version, propagate_version = true)]
struct Words {
    /// Worker threads; results do not depend on it. 0 takes one per core.
    #[arg(long, global = true, default_value_t = 0, value_name = "N", value_parser = clap::value_parser!(u16).range(..=512))]
    threads: u16,

    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Run everything that can run here, and write the whole report: every table and plot, measured beside published.
    Reproduce(Skipping<reproduce::Words>),
    /// Look at datasets, convert them, cut frames, undistort.
    #[command(subcommand)]
    Data(data::Command),
    /// List, lint, build and derive evaluation protocols.
    #[command(subcommand)]
    Protocol(protocol::Command),
    /// Run methods on protocols into a results store; goes on where it was left.
    Run(Box<Skipping<run::Words>>),
    /// Score pictures or Gaussians that any other method wrote, under a protocol.
    Score(Box<Skipping<run::score::Words>>),
    /// Put the shards of a run together.
    Merge(run::merge::Words),
    /// Put results beside the paper: tables, plots and one HTML page.
    Report(Skipping<report::Words>),
    /// Reconstruct Gaussians from posed photos.
    Reconstruct(Box<reconstruct::Words>),
    /// Render Gaussians along a path into PNG, EXR and an animation.
    Render(Box<Skipping<render::Words>>),
    /// Print how many tokens and Gaussians each of the paper's settings makes, beside its published figures.
    Budget(budget::Words),
    /// Import, export, inspect and verify weights.
    #[command(subcommand)]
    Weights(weights::Command),
    /// Compare results with a baseline: what moved, and which stage moved it; exits with 3 where something did.
    Drift(drift::Words),
    /// Which ways to run a method are worth their time and their Gaussians.
    Tradeoff(tradeoff::Words),
    /// List graphics adapters, and test each.
    Adapters(adapters::Words),
    /// Train a network as a configuration says; a run can be killed at any moment and resumed to the same bits.
    Train(train::Words),
    /// Put every renderer through the hard cases; exits with 1 where one fails.
    Stress(stress::Words),
}

fn main() -> ExitCode {
    let words = Words::parse();
    match run(&words) {
        Ok(exit) => exit.into(),
        Err(error) if error.is::<clap::Error>() => {
            output::complain(&format!("{error}"));
            Exit::WrongWords.into()
        }
        Err(error) => {
            output::complain(&format!("error: {}", told_once(&error)));
            ExitCode::FAILURE
        }
    }
}

/// The error and its causes; a cause whose text its own error already quotes is left out.
fn told_once(error: &anyhow::Error) -> String {
    let mut text = error.to_string();
    for cause in error.chain().skip(1).map(ToString::to_string) {
        if !text.contains(&cause) {
            text.push_str(": ");
            text.push_str(&cause);
        }
    }
    text
}

const fn tested(passed: bool) -> Exit {
    if passed { Exit::Done } else { Exit::Failed }
}

fn run(words: &Words) -> anyhow::Result<Exit> {
    rayon::ThreadPoolBuilder::new()
        .num_threads(words.threads.into())
        .build_global()
        .context("starting worker threads")?;
    match &words.command {
        Command::Reproduce(words) => words.run(reproduce::run),
        Command::Data(command) => data::run(command),
        Command::Protocol(command) => protocol::run(command),
        Command::Render(words) => words.run(render::run),
        Command::Run(words) => words.run(run::run),
        Command::Score(words) => words.run(run::score::run),
        Command::Merge(words) => done(run::merge::run(words)),
        Command::Report(words) => words.run(report::run),
        Command::Reconstruct(words) => done(reconstruct::run(words)),
        Command::Weights(command) => done(weights::run(command)),
        Command::Adapters(words) => done(adapters::run(words)),
        Command::Drift(words) => drift::run(words),
        Command::Tradeoff(words) => tradeoff::run(words),
        Command::Budget(words) => Ok(tested(budget::run(words)?)),
        Command::Train(words) => train::run(words).map(|()| Exit::Done),
        Command::Stress(words) => Ok(tested(stress::run(words)?)),
    }
}
