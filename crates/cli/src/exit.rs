use std::process::ExitCode;

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
