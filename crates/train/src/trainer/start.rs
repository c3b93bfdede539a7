//! What a run goes on from: new weights, given ones, or its last checkpoint.

use std::path::Path;

use atsplat_files::{FolderLock, remove_abandoned};
use atsplat_model::ModelConfig;
use atsplat_model::weights::{ModelWeights, StoredTensor, StoredTensors, TensorFile, read_backbone};
use atsplat_numeric::counted;

use super::computed_by::{ComputedBy, Resumed};
use super::initial_weights::{differences, first_names, require_f16};
use super::{EVALUATIONS, STEPS, WEIGHTS};
use crate::checkpoint::{ChangedSettings, Checkpoints, Found, InitialWeights, MovedData, State};
use crate::config::WHAT;
use crate::logs::{self, StepRecord};
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
    const fn is_resumed(&self) -> bool {
        matches!(self, Self::Resume)
    }

    /// The file of the weights that a run starts from.
    pub(super) fn file(&self) -> Option<&TensorFile> {
        match self {
            Self::Weights(file) => Some(file),
            Self::Fresh | Self::Resume => None,
        }
    }
}

/// Resuming needs a folder in which a run was started: its log follows the checkpoint of given weights.
pub(super) fn require_run_to_resume(folder: &Path, start: &Start) -> Result<(), TrainError> {
    if !start.is_resumed() || folder.join(STEPS).is_file() || Checkpoints::exist_in(folder)? {
        return Ok(());
    }
    let expected = "a run to resume; start one without `--resume`";
    Err(TrainError::malformed("output folder", folder.display().to_string(), expected, "none"))
}

/// An error for a new run in the folder of another, before its checkpoints are compared with a configuration that is not theirs.
pub(super) fn require_no_run(folder: &Path, start: &Start) -> Result<(), TrainError> {
    let has_checkpoints = Checkpoints::exist_in(folder)?;
    if start.is_resumed() || !has_checkpoints {
        return Ok(());
    }
    let expected = "no run; choose another folder, or `--resume`";
    Err(TrainError::malformed("output folder", folder.display().to_string(), expected, "one with checkpoints"))
}

/// An error for a new run without weights whose configuration says that it starts from given ones.
pub(super) fn require_weights(config: &TrainConfig, start: &Start) -> Result<(), TrainError> {
    match start {
        Start::Fresh => allow_new_weights(config),
        Start::Weights(_) | Start::Resume => Ok(()),
    }
}

/// An error for a new run whose windows hold no sample of one of its numbers of views.
pub(super) fn require_windows(config: &TrainConfig, start: &Start) -> Result<(), TrainError> {
    if start.is_resumed() { Ok(()) } else { config.check_new_run() }
}

/// For a run that is resumed, the error that a new one would have.
pub(super) fn rejected_windows(config: &TrainConfig, start: &Start) -> Option<String> {
    let error = start.is_resumed().then(|| config.check_new_run().err()).flatten()?;
    Some(format!("the run goes on as it began, but a new one would be rejected: {error}"))
}

/// An error if a run must not start from newly initialised weights.
fn allow_new_weights(config: &TrainConfig) -> Result<(), TrainError> {
    let field = match (config.model.init, config.model.fresh.is_empty()) {
        (false, true) => return Ok(()),
        (true, _) => "model.init",
        (false, false) => "model.fresh",
    };
    Err(TrainError::malformed(WHAT, field, "a run that starts from given weights (`--init`)", "none"))
}

/// Locks the folder of a run, if there is one, before anything in it is read that another process may be writing.
pub(super) fn lock_existing(folder: &Path) -> Result<Option<FolderLock>, TrainError> {
    Ok(folder.is_dir().then(|| FolderLock::of(folder)).transpose()?)
}

/// Removes what trainings that were killed have left unfinished in the locked folder of a run, and says so.
pub(super) fn remove_unfinished(folder: &Path) -> Result<Option<String>, TrainError> {
    let mut removed = 0;
    for folder in [folder.to_owned(), Checkpoints::folder_in(folder)] {
        if folder.is_dir() {
            removed += remove_abandoned(&folder).map_err(TrainError::io("removing unfinished files", folder))?;
        }
    }
    let files = counted(removed, "unfinished file");
    Ok((removed > 0).then(|| format!("removed {files} from {}, of a training that was killed", folder.display())))
}

/// Creates and locks the folder of a new run, unless another process has started one there in the meantime.
pub(super) fn lock_new(folder: &Path) -> Result<FolderLock, TrainError> {
    let lock = FolderLock::of(folder)?;
    if Checkpoints::exist_in(folder)? || outputs_in(folder).is_some() {
        return Err(no_run(folder, "one that another process has started"));
    }
    Ok(lock)
}

fn no_run(folder: &Path, found: impl ToString) -> TrainError {
    TrainError::malformed("output folder", folder.display().to_string(), "no run", found)
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
}

/// The state before the next step in a run's folder.
pub(super) fn state(
    config: &TrainConfig,
    model: &ModelConfig,
    start: &Start,
    (folder, checkpoints): (&Path, &Checkpoints),
    computed_by: &ComputedBy,
) -> Result<Opened, TrainError> {
    let Initial { parameters, weights: initial_weights, differences } = initial(config, model, start)?;
    let found = checkpoints.read(config, &parameters, &|| frozen(config, model))?;
    let last_checkpoint = found.as_ref().map(|found| found.state.step);
    let weights = start.file().map(|file| file.path.display().to_string());
    tracing::info!(folder = %folder.display(), weights, last_checkpoint, "opening the run");
    match (found, start) {
        (Some(Found { state, skipped, changed }), Start::Resume) => {
            let Resumed { state, notices, processor_changed } = computed_by.resume(state)?;
            let skipped = skipped.into_iter().map(|reason| format!("skipped a checkpoint: {reason}"));
            let (changed, moved) = changed.map(|ChangedSettings { notice, moved }| (notice, moved)).unzip();
            let notices = skipped.chain(notices).chain(changed).collect();
            Ok(Opened { state, notices, processor_changed, moved: moved.unwrap_or_default() })
        }
        (Some(Found { state, .. }), Start::Fresh | Start::Weights(_)) => {
            Err(no_run(folder, format!("one of {} steps", state.step)))
        }
        (None, _) => {
            if let Some(left) = outputs_in(folder).filter(|_| !start.is_resumed()) {
                return Err(no_run(folder, format!("{left} of a run without checkpoints")));
            }
            if start.is_resumed() {
                require_no_lost_checkpoint(folder, config)?;
                allow_new_weights(config)?;
            }
            let parameters =
                if start.is_resumed() { parameters.with_frozen(frozen(config, model)?) } else { parameters };
            let state = computed_by.start(State { initial_weights, ..State::new(parameters) });
            let state = if config.average.is_some() { state.with_average() } else { state };
            let notice = "no checkpoint was written: the run restarts at step 0, from newly initialised weights";
            let notices = start.is_resumed().then(|| notice.to_owned());
            let notices = notices.into_iter().chain(differences).collect();
            Ok(Opened { state, notices, processor_changed: false, moved: MovedData::default() })
        }
    }
}

/// What the first step or checkpoint of a new run would overwrite in a folder: a log with records, or weights.
fn outputs_in(folder: &Path) -> Option<&'static str> {
    [STEPS, EVALUATIONS, WEIGHTS].into_iter().find(|name| has_content(folder, name))
}

fn has_content(folder: &Path, name: &str) -> bool {
    folder.join(name).metadata().is_ok_and(|found| found.len() > 0)
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

/// Parameters before the first step.
struct Initial {
    /// Those of a run that resumes are without frozen ones, which its checkpoint may contain.
    parameters: Parameters,
    /// Where they come from, if they are given.
    weights: Option<InitialWeights>,
    /// In what given ones differ from the run.
    differences: Vec<String>,
}

fn initial(config: &TrainConfig, model: &ModelConfig, start: &Start) -> Result<Initial, TrainError> {
    let file = match start {
        Start::Weights(file) => file,
        Start::Fresh | Start::Resume => {
            let frozen = if start.is_resumed() { StoredTensors::default() } else { frozen(config, model)? };
            let parameters = Parameters::fresh(model, config.seed, frozen);
            if let (Start::Fresh, Some(backbone)) = (start, &config.model.backbone) {
                require_f16(&parameters, backbone)?;
            }
            return Ok(Initial { parameters, weights: None, differences: Vec::new() });
        }
    };
    let weights = ModelWeights::of_file(file)?;
    #[expect(clippy::expect_used, reason = "weights that were read from a file have its hash")]
    let sha256 = weights.sha256.clone().expect("the hash of the file");
    let data = weights.provenance.get("data").cloned();
    let parameters = Parameters::from_weights(model, &weights.tensors, &config.model.fresh, config.seed);
    let mut parameters = parameters.map_err(|error| error.in_file(&file.path))?;
    if let Some(backbone) = &config.model.backbone {
        let exact = frozen(config, model)?;
        require_same(parameters.frozen(), &exact, (&file.path, backbone))?;
        parameters = parameters.with_frozen(exact);
    }
    require_f16(&parameters, &file.path)?;
    let differences = differences(config, model, &weights)?;
    let recorded = (!differences.is_empty()).then(|| differences.join("; "));
    let weights = Some(InitialWeights { sha256, data, differences: recorded });
    Ok(Initial { parameters, weights, differences })
}

/// The weights of a frozen backbone, from the file that the configuration names.
pub(crate) fn frozen(config: &TrainConfig, model: &ModelConfig) -> Result<StoredTensors, TrainError> {
    match &config.model.backbone {
        Some(path) => Ok(read_backbone(path, model, None)?.tensors),
        None if model.backbone.is_frozen() => {
            let expected =
                "the file of the frozen backbone's weights, or a run from weights that contain them (`--init`)";
            Err(TrainError::malformed(WHAT, "model.backbone", expected, "none"))
        }
        None => Ok(StoredTensors::default()),
    }
}

/// An error for given weights whose frozen tensors are not those of the backbone's file, exactly or rounded as weights files are.
fn require_same(
    given: &StoredTensors,
    exact: &StoredTensors,
    (weights, backbone): (&Path, &Path),
) -> Result<(), TrainError> {
    let mut others = Vec::new();
    for (name, tensor) in &given.tensors {
        let is_same = exact.tensors.get(name).is_some_and(|exact| is_rounding_of(tensor, exact));
        if !is_same {
            others.push(name.as_str());
        }
    }
    if others.is_empty() {
        return Ok(());
    }
    let expected = format!("the frozen weights in {}, up to rounding", weights.display());
    let found = format!("others in {}: {}", backbone.display(), first_names(&others));
    Err(TrainError::malformed(WHAT, "model.backbone", expected, found))
}

/// Whether values are the exact ones, or these rounded to f16 or bf16.
fn is_rounding_of(values: &StoredTensor, exact: &StoredTensor) -> bool {
    let same = |rounded: &StoredTensor| {
        let [values, rounded] = [values, rounded].map(StoredTensor::to_f32);
        matches!((values, rounded), (Ok(values), Ok(rounded)) if values == rounded)
    };
    values.shape() == exact.shape() && (same(exact) || [exact.to_f16(), exact.to_bf16()].iter().flatten().any(same))
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
        assert!(require_run_to_resume(log, &Start::Resume).is_ok(), "killed before its first checkpoint");
        assert!(require_run_to_resume(checkpoints, &Start::Resume).is_ok());
        assert!(require_run_to_resume(neither, &Start::Fresh).is_ok());
        // Given weights, if there were any, were not written yet.
        let error = require_run_to_resume(neither, &Start::Resume).unwrap_err().to_string();
        assert!(error.contains("neither: expected a run to resume"), "{error}");
    }

    /// That there are no checkpoints is not known.
    #[test]
    fn checkpoints_that_cannot_be_listed_are_an_error() {
        let run = tempfile::tempdir().unwrap();
        std::fs::write(run.path().join("checkpoints"), "no folder").unwrap();
        let errors = [
            require_run_to_resume(run.path(), &Start::Resume).unwrap_err(),
            lock_new(run.path()).map(drop).unwrap_err(),
        ];
        for error in errors {
            assert!(error.to_string().contains("listing checkpoints"), "{error}");
            assert!(matches!(error, TrainError::Io(_)), "{error}");
        }
        assert!(require_run_to_resume(run.path(), &Start::Fresh).is_ok());
    }

    /// Of two processes that found no folder, one creates it and may have ended when the other locks it.
    #[test]
    fn a_new_run_does_not_follow_one_that_was_started_meanwhile() {
        let folder = tempfile::tempdir().unwrap();
        let run = folder.path().join("run");
        let lock = lock_new(&run).unwrap();
        std::fs::write(run.join(WEIGHTS), "weights").unwrap();
        assert!(matches!(lock_new(&run), Err(TrainError::InUse { .. })));
        drop(lock);
        let error = lock_new(&run).unwrap_err().to_string();
        assert!(error.ends_with("expected no run, found one that another process has started"), "{error}");
    }
}
