//! `atsplat weights`: files of numbers, looked at, checked, and brought under this toolkit's names. One file per verb.

mod backbone;
mod export;
mod import;
mod inspect;
mod precision;
mod verify;

use clap::Subcommand;

#[derive(Debug, Subcommand)]
pub(crate) enum Command {
    /// Make a weights file of a PyTorch checkpoint or of safetensors, by a map of names.
    Import(Box<import::Words>),
    /// Write a weights file's tensors under somebody else's names.
    Export(export::Words),
    /// Print what a file holds; nothing is refused.
    Inspect(inspect::Words),
    /// Check hash, names, shapes and numbers; exits with 1 where something is wrong.
    Verify(verify::Words),
}

/// Runs one command; `true`, since nothing is skipped.
pub(crate) fn run(command: &Command) -> anyhow::Result<bool> {
    match command {
        Command::Import(words) => import::run(words),
        Command::Export(words) => export::run(words),
        Command::Inspect(words) => inspect::run(words),
        Command::Verify(words) => verify::run(words),
    }
}
