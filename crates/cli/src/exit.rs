use std::process::ExitCode;

use clap::Args;

/// How a command ended; the numbers are part of the command line's contract.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Exit {
    /// Done.
    Done,
    /// Words that do not fit together; the parser itself leaves with the same code.
    WrongWords,
    /// Done, and what was tested failed.
    Failed,
    /// Done, and numbers moved away from their baseline.
    Drifted,
    /// Done, but scenes were skipped and `--strict` was given.
    Skipped,
}

impl From<Exit> for ExitCode {
    fn from(exit: Exit) -> Self {
        match exit {
            Exit::Done => Self::SUCCESS,
            Exit::WrongWords => Self::from(2),
            Exit::Failed => Self::FAILURE,
            Exit::Drifted => Self::from(3),
            Exit::Skipped => Self::from(4),
        }
    }
}

// A command that may skip scenes or frames; other commands have no `--strict`.
#[derive(Debug, Args)]
pub(crate) struct Skipping<A: Args> {
    #[command(flatten)]
    args: A,

    /// Exit with code 4 where scenes or frames had to be skipped.
    #[arg(long)]
    strict: bool,
}

impl<A: Args> Skipping<A> {
    /// Runs the command, which says whether it skipped nothing.
    pub(crate) fn run(&self, command: impl FnOnce(&A) -> anyhow::Result<bool>) -> anyhow::Result<Exit> {
        let complete = command(&self.args)?;
        Ok(if self.strict && !complete { Exit::Skipped } else { Exit::Done })
    }
}

/// How a command ends that skips nothing.
pub(crate) fn done(outcome: anyhow::Result<bool>) -> anyhow::Result<Exit> {
    outcome.map(|_complete| Exit::Done)
}
