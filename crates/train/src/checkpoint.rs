//! Checkpoints: safetensors files with everything that a run needs to resume as if uninterrupted.

use std::path::{Path, PathBuf};

use atsplat_model::parameters::Parameter;
use atsplat_model::weights::{StoredTensor, StoredTensors, TensorFile};

use crate::optimiser::Moments;
use crate::parameters::Parameters;
use crate::{TrainConfig, TrainError};

const WHAT: &str = "checkpoint";
const FORMAT: &str = "1";
const PARTS: [&str; 3] = ["weights", "first-moment", "second-moment"];
const AVERAGE: &str = "average";
const INITIAL_WEIGHTS: &str = "initial-weights-sha256";
const ADAPTER: &str = "adapter";

/// The state of a run between two steps.
#[derive(Clone, Debug)]
pub struct State {
    /// Steps done, including skipped ones.
    pub step: u64,
    /// Optimiser updates: steps that were not skipped.
    pub updates: u64,
    /// Number of the latest steps that were skipped in a row.
    pub faults_in_a_row: u32,
    /// Weights.
    pub parameters: Parameters,
    /// Moments of the optimiser, in the order of the parameters.
    pub moments: Vec<Moments>,
    /// Moving averages of the weights, in the order of the parameters, if the configuration has `average`.
    pub average: Option<Vec<Vec<f32>>>,
    /// SHA-256 of the weights file that the run started from, if any.
    pub initial_weights: Option<String>,
    /// The graphics adapter that the run is computed on, with its driver; `None` for the CPU.
    pub adapter: Option<String>,
}

impl State {
    /// The state before the first step.
    pub fn new(parameters: Parameters) -> Self {
        let moments = parameters.values().iter().map(|values| Moments::zeros(values.len())).collect();
        let (average, initial_weights, adapter) = (None, None, None);
        Self { step: 0, updates: 0, faults_in_a_row: 0, parameters, moments, average, initial_weights, adapter }
    }

    /// The same state with moving averages that start at the weights.
    #[must_use]
    pub fn with_average(self) -> Self {
        Self { average: Some(self.parameters.values().to_vec()), ..self }
    }

    /// The run's weights: the moving averages if there are any.
    pub fn result(&self) -> Parameters {
        let mut result = self.parameters.clone();
        for (values, average) in result.values_mut().iter_mut().zip(self.average.iter().flatten()) {
            values.clone_from(average);
        }
        result
    }

    /// Number of skipped steps.
    pub const fn skipped(&self) -> u64 {
        self.step - self.updates
    }

    fn stored(&self, config: &TrainConfig) -> Result<StoredTensors, TrainError> {
        let mut stored = StoredTensors::default();
        let list = self.parameters.list().iter().zip(self.parameters.values()).zip(&self.moments);
        for ((parameter, values), moments) in list {
            for (part, numbers) in PARTS.into_iter().zip([values, &moments.first, &moments.second]) {
                let tensor = StoredTensor::from_f32(parameter.shape.clone(), numbers)?;
                stored.tensors.insert(format!("{part}/{}", parameter.name), tensor);
            }
        }
        for (parameter, values) in self.parameters.list().iter().zip(self.average.iter().flatten()) {
            let tensor = StoredTensor::from_f32(parameter.shape.clone(), values)?;
            stored.tensors.insert(format!("{AVERAGE}/{}", parameter.name), tensor);
        }
        stored.metadata = [
            ("atsplat.checkpoint", FORMAT.to_owned()),
            ("step", self.step.to_string()),
            ("updates", self.updates.to_string()),
            ("faults-in-a-row", self.faults_in_a_row.to_string()),
            ("configuration", config.to_toml()?),
            ("tensors-sha256", stored.digest()),
        ]
        .map(|(key, value)| (key.to_owned(), value))
        .into();
        if let Some(hash) = &self.initial_weights {
            stored.metadata.insert(INITIAL_WEIGHTS.to_owned(), hash.clone());
        }
        if let Some(adapter) = &self.adapter {
            stored.metadata.insert(ADAPTER.to_owned(), adapter.clone());
        }
        Ok(stored)
    }

    /// Reads a state from a file, except for the frozen weights, which come from `fresh`.
    fn from_stored(stored: &StoredTensors, config: &TrainConfig, fresh: &Parameters) -> Result<Self, TrainError> {
        let text = |key: &str| {
            let found = stored.metadata.get(key);
            found.ok_or_else(|| TrainError::malformed(WHAT, format!("metadata {key}"), "a value", "no such entry"))
        };
        let number = |key: &str| {
            let found = text(key)?;
            let malformed = |_| TrainError::malformed(WHAT, format!("metadata {key}"), "a whole number", found);
            found.parse::<u64>().map_err(malformed)
        };
        let expect = |key: &str, expected: &str, what: &str| match text(key)? {
            found if found == expected => Ok(()),
            found => Err(TrainError::malformed(WHAT, format!("metadata {key}"), what.to_owned(), found)),
        };
        expect("atsplat.checkpoint", FORMAT, FORMAT)?;
        expect("tensors-sha256", &stored.digest(), "the hash of the tensors")?;
        let configuration = text("configuration")?;
        if TrainConfig::from_toml(configuration)? != *config {
            let expected = "the configuration that the run was started with; start a new run from its weights instead";
            return Err(TrainError::malformed(WHAT, "configuration", expected, "another"));
        }
        let values = |part: &str, parameter: &Parameter| {
            let name = format!("{part}/{}", parameter.name);
            let tensor = stored.tensors.get(&name).filter(|tensor| tensor.shape() == parameter.shape);
            let absent =
                || TrainError::malformed(WHAT, name.clone(), format!("a tensor of {:?}", parameter.shape), "none");
            Ok::<_, TrainError>(tensor.ok_or_else(absent)?.to_f32()?)
        };
        let mut parameters = fresh.clone();
        let mut moments = Vec::new();
        let mut average = config.average.map(|_| Vec::new());
        for (position, parameter) in fresh.list().iter().enumerate() {
            let [weights, first, second] = PARTS.map(|part| values(part, parameter));
            parameters.values_mut()[position] = weights?;
            moments.push(Moments { first: first?, second: second? });
            if let Some(average) = &mut average {
                average.push(values(AVERAGE, parameter)?);
            }
        }
        let faults_in_a_row = u32::try_from(number("faults-in-a-row")?)
            .map_err(|error| TrainError::malformed(WHAT, "metadata faults-in-a-row", "a number of 32 bits", error))?;
        let [initial_weights, adapter] = [INITIAL_WEIGHTS, ADAPTER].map(|key| stored.metadata.get(key).cloned());
        let (step, updates) = (number("step")?, number("updates")?);
        Ok(Self { step, updates, faults_in_a_row, parameters, moments, average, initial_weights, adapter })
    }
}

/// The checkpoint folder of a run.
#[derive(Clone, Debug)]
pub struct Checkpoints {
    folder: PathBuf,
    keep: usize,
}

impl Checkpoints {
    /// The checkpoint folder in a run's folder, created if absent.
    ///
    /// # Errors
    /// [`TrainError::Io`].
    pub fn new(folder: &Path, keep: usize) -> Result<Self, TrainError> {
        let folder = folder.join("checkpoints");
        std::fs::create_dir_all(&folder).map_err(TrainError::io("creating a folder", &folder))?;
        Ok(Self { folder, keep })
    }

    /// Writes a checkpoint atomically, and removes the oldest ones beyond the number to keep.
    ///
    /// # Errors
    /// [`TrainError::Malformed`] if a weight is NaN or infinite: such a state is not written; [`TrainError::Model`] if the
    /// file cannot be written.
    pub fn write(&self, state: &State, config: &TrainConfig) -> Result<PathBuf, TrainError> {
        if let Some((name, count)) = state.parameters.non_finite().into_iter().next() {
            let found = format!("{count} values that are NaN or infinite");
            return Err(TrainError::malformed(WHAT, name, "finite weights", found));
        }
        let path = self.folder.join(format!("step-{:08}.safetensors", state.step));
        state.stored(config)?.write(&path)?;
        let mut all = self.all()?;
        all.pop();
        let beyond = all.len().saturating_sub(self.keep.saturating_sub(1));
        for old in all.iter().take(beyond) {
            std::fs::remove_file(old).map_err(TrainError::io("removing an old checkpoint", old))?;
        }
        Ok(path)
    }

    /// The newest readable state, with a message for each newer checkpoint that cannot be read; `None` if there is no
    /// checkpoint.
    ///
    /// # Errors
    /// [`TrainError`] of the newest checkpoint if there are checkpoints and none can be read.
    pub fn read(&self, config: &TrainConfig, fresh: &Parameters) -> Result<Option<(State, Vec<String>)>, TrainError> {
        let (mut messages, mut first) = (Vec::new(), None);
        for path in self.all()?.iter().rev() {
            let state = TensorFile::open(path)
                .map_err(TrainError::from)
                .and_then(|file| State::from_stored(&file.stored, config, fresh));
            match state {
                Ok(state) => return Ok(Some((state, messages))),
                Err(error) => {
                    messages.push(format!("{}: {error}", path.display()));
                    first.get_or_insert(error);
                }
            }
        }
        first.map_or(Ok(None), Err)
    }

    /// All checkpoints, oldest first.
    fn all(&self) -> Result<Vec<PathBuf>, TrainError> {
        let reading = || TrainError::io("listing checkpoints", &self.folder);
        let mut all = Vec::new();
        for entry in std::fs::read_dir(&self.folder).map_err(reading())? {
            let path = entry.map_err(reading())?.path();
            let name = path.file_name().and_then(std::ffi::OsStr::to_str);
            if name.is_some_and(|name| name.starts_with("step-") && name.ends_with(".safetensors")) {
                all.push(path);
            }
        }
        all.sort();
        Ok(all)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn other_files_in_the_folder_are_no_checkpoints() {
        let folder = tempfile::tempdir().unwrap();
        let checkpoints = Checkpoints::new(folder.path(), 2).unwrap();
        let files = ["step-00000012.safetensors", "step-00000004.safetensors", "step-notes.txt", "best.safetensors"];
        for name in files {
            std::fs::write(checkpoints.folder.join(name), "").unwrap();
        }
        let expected = ["step-00000004.safetensors", "step-00000012.safetensors"];
        assert_eq!(checkpoints.all().unwrap(), expected.map(|name| checkpoints.folder.join(name)));
    }
}
