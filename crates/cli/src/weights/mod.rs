//! `atsplat weights`: one file per subcommand.

mod export;
mod import;
mod inspect;
mod verify;

use clap::Subcommand;

#[derive(Debug, Subcommand)]
pub(crate) enum Command {
    /// Convert a PyTorch checkpoint or safetensors to a weights file, by a key map.
    Import(Box<import::Args>),
    /// Write the tensors of a weights file under other names.
    Export(export::Args),
    /// Print the contents of a file, even if it is invalid.
    Inspect(inspect::Args),
    /// Check hash, names, shapes and numbers; exits with 1 if something is wrong.
    Verify(verify::Args),
}

/// Runs a subcommand.
pub(crate) fn run(command: &Command) -> anyhow::Result<()> {
    match command {
        Command::Import(args) => import::run(args),
        Command::Export(args) => export::run(args),
        Command::Inspect(args) => inspect::run(args),
        Command::Verify(args) => verify::run(args),
    }
}
