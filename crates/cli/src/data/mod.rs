use clap::Subcommand;

/// What can be asked for.
#[derive(Debug, Subcommand)]
pub(crate) enum Command {}

/// Runs one command; `true` where nothing was skipped.
pub(crate) fn run(command: &Command) -> anyhow::Result<bool> {
    match *command {}
}
