//! A new run: from newly initialised weights or from given ones, in a folder without a run.

use std::path::Path;

use atsplat_files::FolderLock;
use atsplat_model::weights::{ModelWeights, TensorFile};

use super::backbone::{frozen, require_same};
use super::initial_weights::{differences, require_f16};
use super::start::{Opened, Run, remove_unfinished};
use super::{EVALUATIONS, STEPS, WEIGHTS};
use crate::TrainError;
use crate::checkpoint::{Checkpoints, InitialWeights, MovedData};
use crate::parameters::Parameters;

/// An error for the folder of another run, before its checkpoints are compared with a configuration that is not theirs.
pub(super) fn require_no_checkpoints(folder: &Path) -> Result<(), TrainError> {
    if !Checkpoints::exist_in(folder)? {
        return Ok(());
    }
    let expected = "no run; choose another folder, or `--resume`";
    Err(TrainError::malformed("output folder", folder.display().to_string(), expected, "one with checkpoints"))
}

/// The state before the first step, from given weights or newly initialised ones. A folder that exists is locked before anything in
/// it is read that another process may be writing; another is created by [`create`], as soon as nothing can fail any more.
pub(super) fn open(run: &Run<'_>, given: Option<&TensorFile>) -> Result<Opened, TrainError> {
    let lock = run.folder.is_dir().then(|| FolderLock::of(run.folder)).transpose()?;
    let unfinished = lock.as_ref().map(remove_unfinished).transpose()?.flatten();
    // Another process may have trained here since the first check.
    require_no_checkpoints(run.folder)?;
    if let Some(left) = outputs_in(run.folder) {
        return Err(no_run(run.folder, format!("{left} of a run without checkpoints")));
    }
    let weights = given.map(|file| file.path.display().to_string());
    tracing::info!(folder = %run.folder.display(), weights, "starting a run");
    let initial = match given {
        None => Initial { parameters: new_parameters(run)?, weights: None, differences: Vec::new() },
        Some(file) => given_parameters(run, file)?,
    };
    let mut notices = initial.differences;
    notices.extend(unfinished);
    Ok(Opened {
        state: run.first_state(initial.parameters, initial.weights),
        notices,
        processor_changed: false,
        moved: MovedData::default(),
        lock,
    })
}

/// Creates and locks the folder of a new run, unless another process has started one there in the meantime.
pub(super) fn create(folder: &Path) -> Result<FolderLock, TrainError> {
    let lock = FolderLock::of(folder)?;
    if Checkpoints::exist_in(folder)? || outputs_in(folder).is_some() {
        return Err(no_run(folder, "one that another process has started"));
    }
    Ok(lock)
}

/// What the first step or checkpoint of a new run would overwrite in a folder: a log with records, or weights.
fn outputs_in(folder: &Path) -> Option<&'static str> {
    [STEPS, EVALUATIONS, WEIGHTS].into_iter().find(|name| has_content(folder, name))
}

/// Whether a run's folder has a file of this name that is not empty.
pub(super) fn has_content(folder: &Path, name: &str) -> bool {
    folder.join(name).metadata().is_ok_and(|found| found.len() > 0)
}

fn no_run(folder: &Path, found: impl ToString) -> TrainError {
    TrainError::malformed("output folder", folder.display().to_string(), "no run", found)
}

/// Parameters before the first step.
struct Initial {
    parameters: Parameters,
    /// Where they come from, if they are given.
    weights: Option<InitialWeights>,
    /// In what given ones differ from the run.
    differences: Vec<String>,
}

/// Newly initialised parameters, with the backbone that the configuration names.
pub(super) fn new_parameters(run: &Run<'_>) -> Result<Parameters, TrainError> {
    let parameters = Parameters::fresh(run.model, run.config.seed, frozen(run.config, run.model)?);
    if let Some(backbone) = &run.config.model.backbone {
        require_f16(&parameters, backbone)?;
    }
    Ok(parameters)
}

/// The parameters in a weights file.
fn given_parameters(run: &Run<'_>, file: &TensorFile) -> Result<Initial, TrainError> {
    let Run { config, model, .. } = *run;
    let weights = ModelWeights::of_file(file)?;
    #[expect(clippy::expect_used, reason = "weights that were read from a file have its hash")]
    let sha256 = weights.sha256.clone().expect("the hash of the file");
    let data = weights.provenance.get("data").cloned();
    let parameters = Parameters::from_weights(model, &weights.tensors, &config.model.fresh, config.seed);
    let mut parameters = parameters.map_err(|error| error.in_file(&file.path))?;
    if let Some(backbone) = &config.model.backbone {
        let exact = frozen(config, model)?;
        require_same(parameters.frozen(), &exact, &file.path, backbone)?;
        parameters = parameters.with_frozen(exact);
    }
    require_f16(&parameters, &file.path)?;
    let differences = differences(config, model, &weights)?;
    let recorded = (!differences.is_empty()).then(|| differences.join("; "));
    let weights = Some(InitialWeights { sha256, data, differences: recorded });
    Ok(Initial { parameters, weights, differences })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Of two processes that found no folder, one creates it and may have ended when the other locks it.
    #[test]
    fn a_new_run_does_not_follow_one_that_was_started_meanwhile() {
        let folder = tempfile::tempdir().unwrap();
        let run = folder.path().join("run");
        let lock = create(&run).unwrap();
        std::fs::write(run.join(WEIGHTS), "weights").unwrap();
        assert!(matches!(create(&run), Err(TrainError::InUse { .. })));
        drop(lock);
        let error = create(&run).unwrap_err().to_string();
        assert!(error.ends_with("expected no run, found one that another process has started"), "{error}");
    }
}
