use std::process::ExitCode;

/// How a command ended; the exit codes are part of the command line's contract.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Exit {
    /// Success.
    Done,
    /// Arguments that contradict each other; the argument parser exits with the same code.
    UsageError,
    /// Done, but a check failed.
    Failed,
    /// Done, but numbers drifted from their baseline.
    Drifted,
    /// Something was skipped, is missing or failed, and `--strict` was given.
    Incomplete,
}

impl From<Exit> for ExitCode {
    fn from(exit: Exit) -> Self {
        match exit {
            Exit::Done => Self::SUCCESS,
            Exit::UsageError => Self::from(2),
            Exit::Failed => Self::FAILURE,
            Exit::Drifted => Self::from(3),
            Exit::Incomplete => Self::from(4),
        }
    }
}

// Arguments of a command that may skip scenes or frames; of others, only `drift accept` has its own `--strict`.
#[derive(Debug, clap::Args)]
pub(crate) struct WithStrict<A: clap::Args> {
    #[command(flatten)]
    args: A,

    /// Exit with code 4 if the results are incomplete: scenes or frames are missing, entries were skipped, targets of an unpublished
    /// index are not where the protocol has them, or a trial failed or rendered no Gaussian.
    #[arg(long)]
    strict: bool,
}

impl<A: clap::Args> WithStrict<A> {
    /// Runs the command, which returns whether its results are complete.
    pub(crate) fn run(&self, command: impl FnOnce(&A) -> anyhow::Result<bool>) -> anyhow::Result<Exit> {
        let complete = command(&self.args)?;
        Ok(if self.strict && !complete { Exit::Incomplete } else { Exit::Done })
    }
}
