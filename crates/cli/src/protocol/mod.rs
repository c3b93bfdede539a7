//! `atsplat protocol`: one file per verb.

mod build;
mod estimators;
mod extrapolate;
mod lint;
mod list;
mod overlap;
pub(crate) mod parse;
mod show;

use clap::Subcommand;

use crate::exit::{Exit, Skipping, done};

#[derive(Debug, Subcommand)]
pub(crate) enum Command {
    /// Print the built-in presets.
    List(list::Words),
    /// Print one preset: every convention, source and inference.
    Show(show::Words),
    /// Print what an index holds that its numbers do not tell: leaks, dropped scenes, bins, comparability.
    Lint(Skipping<lint::Words>),
    /// Measure or read overlaps, write them into an index, draw their histogram.
    Overlap(Box<Skipping<overlap::Words>>),
    /// Measure how well each estimator of overlap predicts what two views of simulated scenes truly share.
    Estimators(estimators::Words),
    /// Derive the split with targets before and after each window of context frames.
    Extrapolate(Skipping<extrapolate::Words>),
    /// Make an index for a dataset that has none.
    Build(Skipping<build::Words>),
}

/// Runs one command; `true` where nothing had to be skipped.
pub(crate) fn run(command: &Command) -> anyhow::Result<Exit> {
    match command {
        Command::List(words) => done(list::run(words)),
        Command::Show(words) => done(show::run(words)),
        Command::Lint(words) => words.run(lint::run),
        Command::Overlap(words) => words.run(overlap::run),
        Command::Estimators(words) => done(estimators::run(words)),
        Command::Extrapolate(words) => words.run(extrapolate::run),
        Command::Build(words) => words.run(build::run),
    }
}
