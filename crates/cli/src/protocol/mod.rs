//! `atsplat protocol`: one file per subcommand.

mod build;
mod estimators;
mod extrapolate;
mod lint;
mod overlap;
mod presets;

use clap::Subcommand;

use crate::exit::{Exit, WithStrict};

const LINT_STRICT: &str = "Exit with code 4 if the index is unfit: leaks or repetitions that are not as published, no \
                           entries, another protocol's index or targets, dropped scenes, or other trials than --against";

const BUILD_STRICT: &str = "Exit with code 4 if a scene has no entry, or frames lack an image that can be read, or a usable \
                            pose";

const EXTRAPOLATE_STRICT: &str = "Exit with code 4 if scenes or entries of the index were skipped, or frames lack an image or \
                                  a usable pose";

const ENTRIES_STRICT: &str = "Exit with code 4 if scenes or entries of the index were skipped";

#[derive(Debug, Subcommand)]
pub(crate) enum Command {
    /// Print the built-in presets.
    List(presets::ListArgs),
    /// Print one preset: every convention, source and inference.
    Show(presets::ShowArgs),
    /// Check an index for leaks, dropped scenes, bins and comparability.
    #[command(mut_arg("strict", |strict| strict.help(LINT_STRICT)))]
    Lint(WithStrict<lint::Args>),
    /// Measure or read overlaps, write them into an index, plot their histogram.
    #[command(mut_arg("strict", |strict| strict.help(ENTRIES_STRICT)))]
    Overlap(Box<WithStrict<overlap::Args>>),
    /// Measure how well each overlap estimator predicts the true co-visibility in simulated scenes.
    Estimators(estimators::Args),
    /// Derive the split with targets before and after each window of context frames.
    #[command(mut_arg("strict", |strict| strict.help(EXTRAPOLATE_STRICT)))]
    Extrapolate(WithStrict<extrapolate::Args>),
    /// Build an index for a dataset that has none.
    #[command(mut_arg("strict", |strict| strict.help(BUILD_STRICT)))]
    Build(WithStrict<build::Args>),
}

/// Runs a subcommand.
pub(crate) fn run(command: &Command) -> anyhow::Result<Exit> {
    match command {
        Command::List(args) => presets::list(args).map(|()| Exit::Done),
        Command::Show(args) => presets::show(args).map(|()| Exit::Done),
        Command::Lint(args) => args.run(lint::run),
        Command::Overlap(args) => args.run(overlap::run),
        Command::Estimators(args) => estimators::run(args).map(|()| Exit::Done),
        Command::Extrapolate(args) => args.run(extrapolate::run),
        Command::Build(args) => args.run(build::run),
    }
}
