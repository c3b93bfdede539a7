//! A run that goes on: from its last checkpoint, or from step 0 if it was killed before the first one.

use std::path::Path;

use atsplat_files::FolderLock;
use atsplat_model::weights::StoredTensors;

use super::backbone::frozen;
use super::computed_by::Resumed;
use super::new_run::{has_content, new_parameters};
use super::start::{Opened, Run, allow_new_weights, remove_unfinished};
use super::{STEPS, WEIGHTS};
use crate::checkpoint::{ChangedSettings, Checkpoints, Found, MovedData};
use crate::logs::{self, StepRecord};
use crate::parameters::Parameters;
use crate::{TrainConfig, TrainError};

/// Resuming needs a folder in which a run was started: its log follows the checkpoint of given weights.
pub(super) fn require_run_to_resume(folder: &Path) -> Result<(), TrainError> {
    if folder.join(STEPS).is_file() || Checkpoints::exist_in(folder)? {
        return Ok(());
    }
    let expected = "a run to resume; start one without `--resume`";
    Err(TrainError::malformed("output folder", folder.display().to_string(), expected, "none"))
}

/// The state before the next step.
pub(super) fn open(run: &Run<'_>) -> Result<Opened, TrainError> {
    // Before anything in the folder is read that another process may be writing.
    let lock = FolderLock::of(run.folder)?;
    let unfinished = remove_unfinished(&lock)?;
    // Without frozen weights, which the checkpoint may contain.
    let parameters = Parameters::fresh(run.model, run.config.seed, StoredTensors::default());
    let found = run.checkpoints.read(run.config, &parameters, &|| frozen(run.config, run.model))?;
    let last_checkpoint = found.as_ref().map(|found| found.state.step);
    tracing::info!(folder = %run.folder.display(), last_checkpoint, "resuming the run");
    let mut opened = match found {
        Some(found) => from_checkpoint(run, found, lock)?,
        None => from_step_0(run, lock)?,
    };
    opened.notices.extend(unfinished);
    opened.notices.extend(rejected(run.config));
    Ok(opened)
}

fn from_checkpoint(run: &Run<'_>, found: Found, lock: FolderLock) -> Result<Opened, TrainError> {
    let Found { state, skipped, changed } = found;
    let Resumed { state, notices, processor_changed } = run.computed_by.resume(state)?;
    let skipped = skipped.into_iter().map(|reason| format!("skipped a checkpoint: {reason}"));
    let (changed, moved) = changed.map(|ChangedSettings { notice, moved }| (notice, moved)).unzip();
    let notices = skipped.chain(notices).chain(changed).collect();
    Ok(Opened { state, notices, processor_changed, moved: moved.unwrap_or_default(), lock: Some(lock) })
}

/// Of a run without checkpoints, which has not lost any and had no given weights: these would be in one.
fn from_step_0(run: &Run<'_>, lock: FolderLock) -> Result<Opened, TrainError> {
    require_no_lost_checkpoint(run.folder, run.config)?;
    allow_new_weights(run.config)?;
    let notice = "no checkpoint was written: the run restarts at step 0, from newly initialised weights";
    Ok(Opened {
        state: run.first_state(new_parameters(run)?, None),
        notices: vec![notice.to_owned()],
        processor_changed: false,
        moved: MovedData::default(),
        lock: Some(lock),
    })
}

/// An error for a run whose checkpoints are gone: newly initialised weights and a new log would replace what it has written. A
/// run that was killed before its first checkpoint has no weights, its log ends before the step that a checkpoint follows, and it did
/// not start from given weights, which a checkpoint at step 0 contains.
fn require_no_lost_checkpoint(folder: &Path, config: &TrainConfig) -> Result<(), TrainError> {
    let logged: Vec<StepRecord> = logs::read(&folder.join(STEPS))?;
    let done = logged.last().map_or(0, |record| record.step + 1);
    let had_checkpoint = done > config.checkpoints.every.get()
        || logged.first().is_some_and(|record| record.initial_weights_sha256.is_some());
    let has_weights = has_content(folder, WEIGHTS);
    if !has_weights && !had_checkpoint {
        return Ok(());
    }
    let (left, from_weights) = if has_weights {
        let path = folder.join(WEIGHTS);
        (WEIGHTS.to_owned(), format!(", from its weights by `--init {}`", path.display()))
    } else {
        (format!("{STEPS} up to step {done}"), String::new())
    };
    let expected = format!(
        "the run's checkpoints in `checkpoints`: put them back, or start a run in another folder{from_weights}"
    );
    let found = format!("none, but {left}");
    Err(TrainError::malformed("output folder", folder.display().to_string(), expected, found))
}

/// The error that a new run would have.
fn rejected(config: &TrainConfig) -> Option<String> {
    let error = config.check_new_run().err()?;
    Some(format!("the run goes on as it began, but a new one would be rejected: {error}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn resuming_needs_a_log_or_checkpoints() {
        let folder = tempfile::tempdir().unwrap();
        let runs = ["log", "checkpoints", "neither"].map(|name| folder.path().join(name));
        for run in &runs {
            std::fs::create_dir_all(run.join("checkpoints")).unwrap();
        }
        let [log, checkpoints, neither] = &runs;
        std::fs::write(log.join(STEPS), "").unwrap();
        std::fs::write(checkpoints.join("checkpoints/step-00000000.safetensors"), "").unwrap();
        assert!(require_run_to_resume(log).is_ok(), "killed before its first checkpoint");
        assert!(require_run_to_resume(checkpoints).is_ok());
        // Given weights, if there were any, were not written yet.
        let error = require_run_to_resume(neither).unwrap_err().to_string();
        assert!(error.contains("neither: expected a run to resume"), "{error}");
    }
}
