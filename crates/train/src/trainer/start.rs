//! How a run starts: as a new one from new or given weights ([`new_run`]), or from where it was stopped ([`resumed`]).

use std::path::Path;

use atsplat_files::{FolderLock, remove_abandoned};
use atsplat_model::ModelConfig;
use atsplat_model::weights::TensorFile;
use atsplat_numeric::counted;

use super::computed_by::ComputedBy;
use super::{new_run, resumed};
use crate::checkpoint::{Checkpoints, InitialWeights, MovedData, State};
use crate::config::WHAT;
use crate::parameters::Parameters;
use crate::{TrainConfig, TrainError};

/// How a run starts.
#[derive(Clone, Debug)]
pub enum Start {
    /// From newly initialised weights, in a folder without a run.
    Fresh,
    /// From the weights in a file of this toolkit, in a folder without a run. A checkpoint at step 0 keeps them.
    Weights(TensorFile),
    /// From the folder's last checkpoint; if none was written yet, from step 0, with a notice. A run whose checkpoints are gone is
    /// an error.
    Resume,
}

impl Start {
    /// Checks the folder and what the configuration says about the start, before any data are opened.
    pub(super) fn check(&self, config: &TrainConfig, folder: &Path) -> Result<(), TrainError> {
        match self {
            Self::Fresh => {
                new_run::require_no_checkpoints(folder)?;
                allow_new_weights(config)?;
                config.check_new_run()
            }
            Self::Weights(_) => {
                new_run::require_no_checkpoints(folder)?;
                config.check_new_run()
            }
            Self::Resume => resumed::require_run_to_resume(folder),
        }
    }

    /// The state before the next step of a run whose start was checked.
    pub(super) fn open(&self, run: &Run<'_>) -> Result<Opened, TrainError> {
        match self {
            Self::Fresh => new_run::open(run, None),
            Self::Weights(file) => new_run::open(run, Some(file)),
            Self::Resume => resumed::open(run),
        }
    }
}

/// A run that is opened.
pub(super) struct Run<'a> {
    pub(super) config: &'a TrainConfig,
    pub(super) model: &'a ModelConfig,
    pub(super) folder: &'a Path,
    pub(super) checkpoints: &'a Checkpoints,
    pub(super) computed_by: &'a ComputedBy,
}

impl Run<'_> {
    /// The state before the first step, with these parameters.
    pub(super) fn first_state(&self, parameters: Parameters, initial_weights: Option<InitialWeights>) -> State {
        let state = self.computed_by.start(State { initial_weights, ..State::new(parameters) });
        if self.config.average.is_some() { state.with_average() } else { state }
    }
}

/// What a run goes on from.
pub(super) struct Opened {
    /// The state before its next step.
    pub(super) state: State,
    /// What readers of the run must know about it.
    pub(super) notices: Vec<String>,
    /// Whether the last checkpoint was computed on another type of processor.
    pub(super) processor_changed: bool,
    /// Which data are read from another path than in the run so far.
    pub(super) moved: MovedData,
    /// Keeps other processes from the folder; `None` for a new run whose folder does not exist yet.
    pub(super) lock: Option<FolderLock>,
}

/// An error if a run must not start from newly initialised weights.
pub(super) fn allow_new_weights(config: &TrainConfig) -> Result<(), TrainError> {
    let field = match (config.model.init, config.model.fresh.is_empty()) {
        (false, true) => return Ok(()),
        (true, _) => "model.init",
        (false, false) => "model.fresh",
    };
    Err(TrainError::malformed(WHAT, field, "a run that starts from given weights (`--init`)", "none"))
}

/// Removes what trainings that were killed have left unfinished in the locked folder of a run, and says so.
pub(super) fn remove_unfinished(lock: &FolderLock) -> Result<Option<String>, TrainError> {
    let run = lock.folder();
    let mut removed = 0;
    for folder in [run.to_owned(), Checkpoints::folder_in(run)] {
        if folder.is_dir() {
            removed += remove_abandoned(&folder).map_err(TrainError::io("removing unfinished files", folder))?;
        }
    }
    let files = counted(removed, "unfinished file");
    Ok((removed > 0).then(|| format!("removed {files} from {}, of a training that was killed", run.display())))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// That there are no checkpoints is not known.
    #[test]
    fn checkpoints_that_cannot_be_listed_are_an_error() {
        let run = tempfile::tempdir().unwrap();
        std::fs::write(run.path().join("checkpoints"), "no folder").unwrap();
        let checked = |start: &Start| start.check(&TrainConfig::shortest(), run.path());
        let created = new_run::create(run.path()).map(drop);
        for outcome in [checked(&Start::Fresh), checked(&Start::Resume), created] {
            let error = outcome.unwrap_err();
            assert!(error.to_string().contains("listing checkpoints"), "{error}");
            assert!(matches!(error, TrainError::Io(_)), "{error}");
        }
    }
}
