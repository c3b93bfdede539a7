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

#[derive(Debug, Subcommand)]
pub(crate) enum Command {
    /// Print the built-in presets.
    List(list::Words),
    /// Print one preset: every convention, source and inference.
    Show(show::Words),
    /// Print what an index holds that its numbers do not tell: leaks, dropped scenes, bins, comparability.
    Lint(lint::Words),
    /// Measure or read overlaps, write them into an index, draw their histogram.
    Overlap(overlap::Words),
    /// Measure how well each estimator of overlap predicts what two views of simulated scenes truly share.
    Estimators(estimators::Words),
    /// Derive the split with targets before and after each window of context frames.
    Extrapolate(extrapolate::Words),
    /// Make an index for a dataset that has none.
    Build(build::Words),
}

/// Runs one command; `true` where nothing had to be skipped.
pub(crate) fn run(command: &Command) -> anyhow::Result<bool> {
    match command {
        Command::List(words) => list::run(words),
        Command::Show(words) => show::run(words),
        Command::Lint(words) => lint::run(words),
        Command::Overlap(words) => overlap::run(words),
        Command::Estimators(words) => estimators::run(words),
        Command::Extrapolate(words) => extrapolate::run(words),
        Command::Build(words) => build::run(words),
    }
}
