//! What a run goes on from: new weights, given ones, or its last checkpoint.

use std::path::Path;

use atsplat_files::FolderLock;
use atsplat_model::ModelConfig;
use atsplat_model::weights::{ModelWeights, StoredTensor, StoredTensors, TensorFile, read_backbone};
use atsplat_splat::cpu;

use super::{EVALUATIONS, STEPS, WEIGHTS};
use crate::checkpoint::{Checkpoints, InitialWeights, State};
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
    /// From the folder's last checkpoint; if none was written yet, from step 0, with a notice.
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
    if !start.is_resumed() || folder.join(STEPS).is_file() || Checkpoints::exist_in(folder) {
        return Ok(());
    }
    let expected = "a run to resume; start one without `--resume`";
    Err(TrainError::malformed("output folder", folder.display().to_string(), expected, "none"))
}

/// Locks the folder of a run, if there is one, before anything in it is read that another process may be writing.
pub(super) fn lock_existing(folder: &Path) -> Result<Option<FolderLock>, TrainError> {
    Ok(folder.is_dir().then(|| FolderLock::of(folder)).transpose()?)
}

/// Creates and locks the folder of a new run, unless another process has started one there in the meantime.
pub(super) fn lock_new(folder: &Path) -> Result<FolderLock, TrainError> {
    let lock = FolderLock::of(folder)?;
    if Checkpoints::exist_in(folder) || outputs_in(folder).is_some() {
        return Err(no_run(folder, "one that another process has started"));
    }
    Ok(lock)
}

fn no_run(folder: &Path, found: impl ToString) -> TrainError {
    TrainError::malformed("output folder", folder.display().to_string(), "no run", found)
}

/// The state before the next step in a run's folder, and notices about it.
pub(super) fn state(
    config: &TrainConfig,
    model: &ModelConfig,
    start: &Start,
    (folder, checkpoints): (&Path, &Checkpoints),
    adapter: Option<String>,
) -> Result<(State, Vec<String>), TrainError> {
    let (parameters, initial_weights) = initial(config, model, start)?;
    let found = checkpoints.read(config, &parameters, &|| frozen(config, model))?;
    let last_checkpoint = found.as_ref().map(|(state, _)| state.step);
    let weights = start.file().map(|file| file.path.display().to_string());
    tracing::info!(folder = %folder.display(), weights, last_checkpoint, "opening the run");
    let processor = cpu::processor();
    match (found, start) {
        (Some((state, skipped)), Start::Resume) => {
            if state.adapter != adapter {
                let name = |adapter: Option<String>| adapter.unwrap_or_else(|| "the CPU".to_owned());
                let expected = format!("{}, on which the run was started", name(state.adapter));
                return Err(TrainError::malformed("checkpoint", "adapter", expected, name(adapter)));
            }
            let skipped = skipped.into_iter().map(|reason| format!("skipped a checkpoint: {reason}"));
            let notices = skipped.chain(other_processor(state.processor.as_deref(), &processor)).collect();
            Ok((State { processor: Some(processor), ..state }, notices))
        }
        (Some((state, _)), Start::Fresh | Start::Weights(_)) => {
            Err(no_run(folder, format!("one of {} steps", state.step)))
        }
        (None, _) => {
            if let Some(left) = outputs_in(folder).filter(|_| !start.is_resumed()) {
                return Err(no_run(folder, format!("{left} of a run without checkpoints")));
            }
            let parameters =
                if start.is_resumed() { parameters.with_frozen(frozen(config, model)?) } else { parameters };
            let processor = Some(processor);
            let state = State { initial_weights, adapter, processor, ..State::new(parameters) };
            let state = if config.average.is_some() { state.with_average() } else { state };
            let notice = "no checkpoint was written: the run restarts at step 0, from newly initialised weights";
            let notices = start.is_resumed().then(|| notice.to_owned());
            Ok((state, notices.into_iter().collect()))
        }
    }
}

/// That a checkpoint was computed on another type of processor; one of an earlier version does not state it.
fn other_processor(recorded: Option<&str>, own: &str) -> Option<String> {
    let recorded = recorded.filter(|recorded| *recorded != own)?;
    Some(format!(
        "the checkpoint was computed on another type of processor, {recorded}, now {own}: the run may not end bit for \
         bit as it would have there"
    ))
}

/// What the first step or checkpoint of a new run would overwrite in a folder: a log with records, or weights.
fn outputs_in(folder: &Path) -> Option<&'static str> {
    let has_content = |name: &&str| folder.join(name).metadata().is_ok_and(|found| found.len() > 0);
    [STEPS, EVALUATIONS, WEIGHTS].into_iter().find(has_content)
}

/// Parameters before the first step, and where they come from if they are given. Those of a run that resumes are without frozen
/// ones, which its checkpoint may hold.
fn initial(
    config: &TrainConfig,
    model: &ModelConfig,
    start: &Start,
) -> Result<(Parameters, Option<InitialWeights>), TrainError> {
    let file = match start {
        Start::Resume => return Ok((Parameters::fresh(model, config.seed, StoredTensors::default()), None)),
        Start::Fresh => return Ok((Parameters::fresh(model, config.seed, frozen(config, model)?), None)),
        Start::Weights(file) => file,
    };
    let weights = ModelWeights::of_file(file)?;
    #[expect(clippy::expect_used, reason = "weights that were read from a file have its hash")]
    let sha256 = weights.sha256.expect("the hash of the file");
    let data = weights.provenance.get("data").cloned();
    let parameters = Parameters::from_weights(model, &weights.tensors, &config.model.fresh, config.seed);
    let mut parameters = parameters.map_err(|error| error.in_file(&file.path))?;
    if let Some(backbone) = &config.model.backbone {
        let exact = frozen(config, model)?;
        require_same(parameters.frozen(), &exact, (&file.path, backbone))?;
        parameters = parameters.with_frozen(exact);
    }
    Ok((parameters, Some(InitialWeights { sha256, data })))
}

/// The weights of a frozen backbone, from the file that the configuration names.
fn frozen(config: &TrainConfig, model: &ModelConfig) -> Result<StoredTensors, TrainError> {
    match &config.model.backbone {
        Some(path) => Ok(read_backbone(path, model, None)?.tensors),
        None if model.backbone.is_frozen() => {
            let expected = "the file of the frozen backbone's weights, or a run from weights that hold them (`--init`)";
            Err(TrainError::malformed(WHAT, "model.backbone", expected, "none"))
        }
        None => Ok(StoredTensors::default()),
    }
}

/// Refuses given weights whose frozen tensors are not those of the backbone's file, exactly or rounded as weights files are.
fn require_same(
    given: &StoredTensors,
    exact: &StoredTensors,
    (weights, backbone): (&Path, &Path),
) -> Result<(), TrainError> {
    const NAMED: usize = 4;
    let mut others = Vec::new();
    for (name, own) in &given.tensors {
        let is_same = exact.tensors.get(name).is_some_and(|exact| is_rounding_of(own, exact));
        if !is_same {
            others.push(name.as_str());
        }
    }
    if others.is_empty() {
        return Ok(());
    }
    let more = match others.len().saturating_sub(NAMED) {
        0 => String::new(),
        more => format!(" and {more} more"),
    };
    others.truncate(NAMED);
    let expected = format!("the frozen weights in {}, up to rounding", weights.display());
    let found = format!("others in {}: {}{more}", backbone.display(), others.join(", "));
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
