//! The state of a run, and how a checkpoint stores it.

use atsplat_model::parameters::Parameter;
use atsplat_model::weights::{CHECKPOINT_KEY, StoredTensor, StoredTensors};

use super::settings::{ChangedSettings, check_settings};
use crate::optimiser::Moments;
use crate::parameters::Parameters;
use crate::samples::ReplacedCount;
use crate::{Resolved, TrainConfig, TrainError};

pub(super) const WHAT: &str = "checkpoint";
const FORMAT: &str = "1";
const PARTS: [&str; 3] = ["weights", "first-moment", "second-moment"];
const AVERAGE: &str = "average";
const FROZEN: &str = "frozen";
const FROZEN_DIGEST: &str = "frozen-sha256";
pub(super) const CONFIGURATION: &str = "configuration";
pub(super) const METADATA_DIGEST: &str = "metadata-sha256";
const INITIAL_WEIGHTS: &str = "initial-weights-sha256";
const INITIAL_DATA: &str = "initial-weights-data";
const INITIAL_DIFFERENCES: &str = "initial-weights-differences";
const ADAPTER: &str = "adapter";
const PROCESSOR: &str = "processor";
const BUILDS: &str = "builds";
const REPLACED: &str = "replaced-draws";
const REPLACED_SINCE: &str = "replaced-draws-since";

/// Weights that a run starts from.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct InitialWeights {
    /// SHA-256 of their file.
    pub sha256: String,
    /// What they were trained on, if their provenance says so.
    pub data: Option<String>,
    /// How their network and training differ from the run's, if they do; none in a checkpoint of an earlier version.
    pub differences: Option<String>,
}

/// The state of a run between two steps.
#[derive(Clone, Debug)]
pub struct State {
    /// Steps done, including skipped ones.
    pub step: u64,
    /// Optimiser updates: steps that were not skipped.
    pub updates: u64,
    /// Number of the latest steps that were skipped in a row.
    pub skipped_in_a_row: u32,
    /// Draws that gave no sample.
    pub replaced: ReplacedCount,
    /// Weights.
    pub parameters: Parameters,
    /// Moments of the optimiser, in the order of the parameters.
    pub moments: Vec<Moments>,
    /// Moving averages of the weights, in the order of the parameters, if the configuration has `average`.
    pub average: Option<Vec<Vec<f32>>>,
    /// The weights that the run started from, if they were given.
    pub initial_weights: Option<InitialWeights>,
    /// The graphics adapter that the run is computed on, with its drivers in the order of their use; `None` for the CPU.
    pub adapter: Option<String>,
    /// The type of processor that the latest steps ran on; `None` in a checkpoint of an earlier version.
    pub processor: Option<String>,
    /// The builds of the program that computed the run, each with its version and its commit if that is known, in the order of their
    /// use; `None` in a checkpoint of an earlier version.
    pub builds: Option<String>,
}

impl State {
    /// The state before the first step.
    pub fn new(parameters: Parameters) -> Self {
        let moments = parameters.values().iter().map(|values| Moments::zeros(values.len())).collect();
        Self {
            step: 0,
            updates: 0,
            skipped_in_a_row: 0,
            replaced: ReplacedCount::default(),
            parameters,
            moments,
            average: None,
            initial_weights: None,
            adapter: None,
            processor: None,
            builds: None,
        }
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
        self.step.saturating_sub(self.updates)
    }

    /// The state as tensors and metadata.
    pub(super) fn stored(&self, config: &TrainConfig, resolved: &Resolved) -> Result<StoredTensors, TrainError> {
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
        // Unlike the file of a backbone, given weights are not read again when the run resumes.
        if self.initial_weights.is_some() {
            for (name, tensor) in &self.parameters.frozen().tensors {
                stored.tensors.insert(format!("{FROZEN}/{name}"), tensor.clone());
            }
        }
        stored.metadata = [
            (CHECKPOINT_KEY, FORMAT.to_owned()),
            ("step", self.step.to_string()),
            ("updates", self.updates.to_string()),
            ("faults-in-a-row", self.skipped_in_a_row.to_string()),
            (REPLACED, self.replaced.count.to_string()),
            (REPLACED_SINCE, self.replaced.since.to_string()),
            (CONFIGURATION, config.to_toml()?),
            (FROZEN_DIGEST, self.parameters.frozen().digest()),
            ("tensors-sha256", stored.digest()),
        ]
        .map(|(key, value)| (key.to_owned(), value))
        .into();
        let given = self.initial_weights.as_ref();
        let optional = [
            (INITIAL_WEIGHTS, given.map(|given| &given.sha256)),
            (INITIAL_DATA, given.and_then(|given| given.data.as_ref())),
            (INITIAL_DIFFERENCES, given.and_then(|given| given.differences.as_ref())),
            (ADAPTER, self.adapter.as_ref()),
            (PROCESSOR, self.processor.as_ref()),
            (BUILDS, self.builds.as_ref()),
        ];
        let present = optional.into_iter().filter_map(|(key, value)| Some((key.to_owned(), value?.clone())));
        stored.metadata.extend(present);
        resolved.add_to(&mut stored);
        let digest = stored.metadata_digest(METADATA_DIGEST);
        stored.metadata.insert(METADATA_DIGEST.to_owned(), digest);
        Ok(stored)
    }

    /// Reads a state from tensors and metadata whose hashes were checked, with the settings of a run, and what has changed in these
    /// without changing the run; frozen weights that are not in the file are those of `backbone`.
    pub(super) fn from_stored(
        stored: &StoredTensors,
        config: &TrainConfig,
        fresh: &Parameters,
        backbone: ReadBackbone<'_>,
    ) -> Result<(Self, Option<ChangedSettings>), TrainError> {
        let changed = check_settings(stored, config)?;
        Ok((Self::from_checked(stored, config, fresh, backbone)?, changed))
    }

    /// [`Self::from_stored`] with the file's own settings.
    pub(super) fn from_checked(
        stored: &StoredTensors,
        config: &TrainConfig,
        fresh: &Parameters,
        backbone: ReadBackbone<'_>,
    ) -> Result<Self, TrainError> {
        let values = |part: &str, parameter: &Parameter| {
            let name = format!("{part}/{}", parameter.name);
            let tensor = stored.tensors.get(&name).filter(|tensor| tensor.shape() == parameter.shape);
            let absent =
                || TrainError::malformed(WHAT, name.clone(), format!("a tensor of {:?}", parameter.shape), "none");
            Ok::<_, TrainError>(tensor.ok_or_else(absent)?.to_f32()?)
        };
        let mut parameters = with_frozen(stored, fresh, backbone)?;
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
        let (step, updates, skipped_in_a_row) = progress(stored)?;
        let [sha256, data, differences, adapter, processor, builds] =
            [INITIAL_WEIGHTS, INITIAL_DATA, INITIAL_DIFFERENCES, ADAPTER, PROCESSOR, BUILDS]
                .map(|key| stored.metadata.get(key).cloned());
        let initial_weights = sha256.map(|sha256| InitialWeights { sha256, data, differences });
        let replaced = if stored.metadata.contains_key(REPLACED) {
            ReplacedCount { count: number(stored, REPLACED)?, since: number(stored, REPLACED_SINCE)? }
        } else {
            // Earlier versions did not count them.
            ReplacedCount { count: 0, since: step }
        };
        Ok(Self {
            step,
            updates,
            skipped_in_a_row,
            replaced,
            parameters,
            moments,
            average,
            initial_weights,
            adapter,
            processor,
            builds,
        })
    }
}

/// Reads the frozen weights of a configuration's backbone.
pub(super) type ReadBackbone<'a> = &'a dyn Fn() -> Result<StoredTensors, TrainError>;

/// An error for another format, and for tensors or metadata that are not those that were written.
pub(super) fn check_digests(stored: &StoredTensors) -> Result<(), TrainError> {
    let expect = |key: &str, expected: &str, what: &str| match entry(stored, key)? {
        found if found == expected => Ok(()),
        found => Err(TrainError::malformed(WHAT, format!("metadata {key}"), what.to_owned(), found)),
    };
    expect(CHECKPOINT_KEY, FORMAT, FORMAT)?;
    expect("tensors-sha256", &stored.digest(), "the hash of the tensors")?;
    // Earlier versions wrote none.
    if stored.metadata.contains_key(METADATA_DIGEST) {
        expect(METADATA_DIGEST, &stored.metadata_digest(METADATA_DIGEST), "the hash of the metadata")?;
    }
    Ok(())
}

/// The steps that were done, those of them that updated the weights, and how many of the latest were skipped in a row. Checkpoints of
/// earlier versions have no hash of these numbers.
fn progress(stored: &StoredTensors) -> Result<(u64, u64, u32), TrainError> {
    let at_most = |key: &str, most: u64, what: &str| match number(stored, key)? {
        found if found <= most => Ok(found),
        found => Err(TrainError::malformed(WHAT, format!("metadata {key}"), format!("at most {most}, {what}"), found)),
    };
    let step = number(stored, "step")?;
    let updates = at_most("updates", step, "the number of steps")?;
    let in_a_row = at_most("faults-in-a-row", step - updates, "the number of steps without an update")?;
    let in_a_row = u32::try_from(in_a_row)
        .map_err(|error| TrainError::malformed(WHAT, "metadata faults-in-a-row", "a number of 32 bits", error))?;
    Ok((step, updates, in_a_row))
}

fn number(stored: &StoredTensors, key: &str) -> Result<u64, TrainError> {
    let found = entry(stored, key)?;
    let malformed = |_| TrainError::malformed(WHAT, format!("metadata {key}"), "a whole number", found);
    found.parse::<u64>().map_err(malformed)
}

/// `fresh` with the frozen weights of a checkpoint, or of `backbone` if it has none. A checkpoint of an earlier version does not
/// state their hash.
fn with_frozen(
    stored: &StoredTensors,
    fresh: &Parameters,
    backbone: ReadBackbone<'_>,
) -> Result<Parameters, TrainError> {
    let mut frozen = StoredTensors::default();
    for (name, tensor) in &stored.tensors {
        if let Some(name) = name.strip_prefix(FROZEN).and_then(|name| name.strip_prefix('/')) {
            frozen.tensors.insert(name.to_owned(), tensor.clone());
        }
    }
    let parameters = fresh.with_frozen(if frozen.tensors.is_empty() { backbone()? } else { frozen });
    let Some(expected) = stored.metadata.get(FROZEN_DIGEST) else { return Ok(parameters) };
    match parameters.frozen().digest() {
        found if found == *expected => Ok(parameters),
        found => {
            let expected = format!("those that the run was started with, sha256 {expected}");
            Err(TrainError::malformed(WHAT, "frozen weights, of model.backbone", expected, found))
        }
    }
}

/// A value of a checkpoint's metadata.
pub(super) fn entry<'a>(stored: &'a StoredTensors, key: &str) -> Result<&'a String, TrainError> {
    let found = stored.metadata.get(key);
    found.ok_or_else(|| TrainError::malformed(WHAT, format!("metadata {key}"), "a value", "no such entry"))
}

/// After this many steps, with one trained and one frozen number.
#[cfg(test)]
pub(super) fn with_one_number(step: u64, frozen: f32) -> State {
    let tensor = |value: f32| StoredTensor::from_f32(vec![1], &[value]).unwrap();
    let parameter = Parameter { name: "weight".to_owned(), shape: vec![1], trained: true };
    let mut tensors = StoredTensors::default();
    tensors.tensors.insert("backbone.weight".to_owned(), tensor(frozen));
    let parameters = Parameters::of_values(vec![parameter], vec![vec![0.5]]).with_frozen(tensors);
    State { step, updates: step, ..State::new(parameters) }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Adam's corrections depend on the number of updates, samples and learning rate on that of steps.
    #[test]
    fn a_damaged_number_is_an_error() {
        let (config, resolved) = (TrainConfig::shortest(), Resolved::default());
        let stored = State { updates: 2, ..with_one_number(3, 1.0) }.stored(&config, &resolved).unwrap();
        let backbone = || Ok(with_one_number(0, 1.0).parameters.frozen().clone());
        let read = |stored: &StoredTensors| {
            check_digests(stored)?;
            State::from_stored(stored, &config, &with_one_number(0, 7.0).parameters, &backbone)
        };
        let (whole, _) = read(&stored).unwrap();
        assert_eq!((whole.step, whole.updates), (3, 2));
        for key in ["step", "updates", "faults-in-a-row"] {
            let mut damaged = stored.clone();
            damaged.metadata.insert(key.to_owned(), "1".to_owned());
            let error = read(&damaged).unwrap_err().to_string();
            assert!(error.contains("metadata metadata-sha256: expected the hash of the metadata"), "{key}: {error}");
        }
    }

    /// Without a hash of the metadata, as in checkpoints of earlier versions.
    #[test]
    fn numbers_of_steps_that_contradict_each_other_are_an_error() {
        let (config, resolved) = (TrainConfig::shortest(), Resolved::default());
        let mut stored = with_one_number(3, 1.0).stored(&config, &resolved).unwrap();
        stored.metadata.remove(METADATA_DIGEST);
        let backbone = || Ok(with_one_number(0, 1.0).parameters.frozen().clone());
        let read = |updates: &str, in_a_row: &str| {
            let mut stored = stored.clone();
            for (key, value) in [("updates", updates), ("faults-in-a-row", in_a_row)] {
                stored.metadata.insert(key.to_owned(), value.to_owned());
            }
            let read = State::from_stored(&stored, &config, &with_one_number(0, 7.0).parameters, &backbone);
            read.map(|(state, _)| (state.skipped(), state.skipped_in_a_row)).map_err(|error| error.to_string())
        };
        assert_eq!(read("1", "2"), Ok((2, 2)));
        for (updates, in_a_row, message) in [
            ("7", "0", "metadata updates: expected at most 3, the number of steps, found 7"),
            ("1", "3", "metadata faults-in-a-row: expected at most 2, the number of steps without an update, found 3"),
        ] {
            let error = read(updates, in_a_row).unwrap_err();
            assert!(error.contains(message), "{error}");
        }
    }

    #[test]
    fn replaced_draws_are_counted_on_and_after_an_earlier_version_from_its_checkpoint() {
        let (config, replaced) = (TrainConfig::shortest(), ReplacedCount { count: 7, since: 2 });
        let mut stored = State { replaced, ..with_one_number(3, 1.0) }.stored(&config, &Resolved::default()).unwrap();
        let backbone = || Ok(with_one_number(0, 1.0).parameters.frozen().clone());
        let read = |stored: &StoredTensors| {
            State::from_stored(stored, &config, &with_one_number(0, 7.0).parameters, &backbone).unwrap().0.replaced
        };
        assert_eq!(read(&stored), replaced);
        stored.metadata.retain(|key, _| ![REPLACED, REPLACED_SINCE, METADATA_DIGEST].contains(&key.as_str()));
        assert_eq!(read(&stored).to_string(), "0 since step 3");
    }

    #[test]
    fn a_changed_backbone_is_an_error_and_given_weights_are_kept() {
        let config = TrainConfig::shortest();
        let resolved = Resolved::default();
        let read = |stored: &StoredTensors, frozen: f32| {
            let backbone = || Ok(with_one_number(0, frozen).parameters.frozen().clone());
            let read = State::from_stored(stored, &config, &with_one_number(0, 7.0).parameters, &backbone);
            read.map(|(state, _)| state.parameters.frozen().digest()).map_err(|error| error.to_string())
        };
        let digest = |frozen: f32| Ok::<_, String>(with_one_number(0, frozen).parameters.frozen().digest());
        let mut stored = with_one_number(3, 1.0).stored(&config, &resolved).unwrap();
        assert_eq!(read(&stored, 1.0), digest(1.0));
        let error = read(&stored, 2.0).unwrap_err();
        assert!(error.contains("model.backbone: expected those that the run was started with"), "{error}");
        stored.metadata.retain(|key, _| ![FROZEN_DIGEST, METADATA_DIGEST].contains(&key.as_str()));
        assert_eq!(read(&stored, 2.0), digest(2.0), "as written by earlier versions");
        let [data, differences] = ["rooms", "settings"].map(|text| Some(text.to_owned()));
        let given = InitialWeights { sha256: "a hash".to_owned(), data, differences };
        let started = State { initial_weights: Some(given.clone()), ..with_one_number(3, 1.0) };
        let stored = started.stored(&config, &resolved).unwrap();
        assert_eq!(read(&stored, 2.0), digest(1.0), "from the checkpoint");
        let absent = || Err(TrainError::malformed(WHAT, "model.backbone", "a file", "none"));
        let (again, _) = State::from_stored(&stored, &config, &with_one_number(0, 2.0).parameters, &absent).unwrap();
        assert_eq!(again.initial_weights, Some(given), "without the file of a backbone");
    }
}
