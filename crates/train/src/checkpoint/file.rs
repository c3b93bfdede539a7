use std::fmt;

use atsplat_model::ModelConfig;
use atsplat_model::weights::{ModelWeights, StoredTensors, TensorFile};

use super::state::{CONFIGURATION, METADATA_DIGEST, State, WHAT, check_digests, entry};
use crate::parameters::Parameters;
use crate::provenance::{MadeWith, provenance};
use crate::resolved::{MODEL, PERCEPTUAL, generation_key, of_data};
use crate::samples::description_of;
use crate::trainer::frozen;
use crate::{SourceConfig, TrainConfig, TrainError};

/// A complete checkpoint, apart from the folder of its run. [`Display`](fmt::Display) says what it contains.
#[derive(Debug)]
pub struct CheckpointFile {
    config: TrainConfig,
    step: u64,
    /// The run's weights at this step: their moving averages if the run has them, and with the frozen backbone.
    pub weights: ModelWeights,
    /// Whether a hash verified the metadata; `false` for a checkpoint of an earlier version.
    pub metadata_covered: bool,
}

impl CheckpointFile {
    /// Whether the metadata are those of a checkpoint.
    pub fn is_one(stored: &StoredTensors) -> bool {
        ModelWeights::is_checkpoint(stored)
    }

    /// Reads a checkpoint, and from the file that its configuration names a frozen backbone that it does not contain. Every tensor
    /// must be there, of its shape and as written, and the weights must be finite.
    ///
    /// # Errors
    /// [`TrainError`] for anything that is not as it was written, and for a network or backbone that is not that of the run.
    pub fn read(file: &TensorFile) -> Result<Self, TrainError> {
        Self::from_stored(&file.stored).map_err(|error| error.in_file(&file.path))
    }

    fn from_stored(stored: &StoredTensors) -> Result<Self, TrainError> {
        check_digests(stored)?;
        let config = TrainConfig::from_toml(entry(stored, CONFIGURATION)?)?;
        let model = config.model.config()?;
        require_model(stored, &model)?;
        let fresh = Parameters::fresh(&model, config.seed, StoredTensors::default());
        let state = State::from_checked(stored, &config, &fresh, &|| frozen(&config, &model))?;
        // Earlier versions did not state it.
        let perceptual = stored.metadata.get(PERCEPTUAL).map_or("not stated", String::as_str);
        let made_with = MadeWith {
            samples: samples(stored, &config),
            perceptual: perceptual.to_owned(),
            identities: of_data(stored.metadata.iter()),
        };
        let provenance = provenance(&config, &state, made_with)?;
        let weights = ModelWeights::new(model, provenance, &state.result().stored()?)?;
        let metadata_covered = stored.metadata.contains_key(METADATA_DIGEST);
        Ok(Self { config, step: state.step, weights, metadata_covered })
    }
}

/// An error for another network than the run's that has the same name.
fn require_model(stored: &StoredTensors, model: &ModelConfig) -> Result<(), TrainError> {
    let found = model.hash()?;
    match stored.metadata.get(MODEL) {
        Some(recorded) if *recorded != found => {
            let expected = format!("{recorded}, the network of the run");
            let named = format!("{found}, which {} is now", model.name);
            Err(TrainError::malformed(WHAT, format!("metadata {MODEL}"), expected, named))
        }
        _ => Ok(()),
    }
}

/// The description of the run's samples, with the generation of the simulator that the checkpoint states.
fn samples(stored: &StoredTensors, config: &TrainConfig) -> String {
    description_of(config.data.iter().enumerate().map(|(at, data)| {
        let source = match &data.source {
            SourceConfig::Rooms(rooms) => {
                let generation = stored.metadata.get(&generation_key(&format!("data[{at}].source")));
                rooms.description(generation.map(String::as_str))
            }
            SourceConfig::Dataset(dataset) => dataset.description(),
        };
        (data.share, source)
    }))
}

impl fmt::Display for CheckpointFile {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { config, step, weights, .. } = self;
        let averages = if config.average.is_some() { ", their averages" } else { "" };
        let model = &weights.config.name;
        write!(f, "a training checkpoint at step {step} of {} of {:?}: ", config.steps, config.title)?;
        write!(f, "weights of the model {model}{averages} and the optimiser's moments")
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Resolved;

    /// With averages that differ from the weights, and an earlier generation of the simulator.
    fn stored() -> StoredTensors {
        let mut config = TrainConfig { average: Some(0.5), ..TrainConfig::shortest() };
        config.losses.background = [0.2, 0.4, 1.0];
        let model = config.model.config().unwrap();
        let mut state = State::new(Parameters::fresh(&model, 1, StoredTensors::default())).with_average();
        for average in state.average.iter_mut().flatten().flatten() {
            *average += 0.25;
        }
        let state = State { step: 3, updates: 2, ..state };
        let mut stored = state.stored(&config, &Resolved::default()).unwrap();
        stored.metadata.insert("data[0].source.rooms.generation".to_owned(), "1".to_owned());
        with_digest(stored)
    }

    fn with_digest(mut stored: StoredTensors) -> StoredTensors {
        let digest = stored.metadata_digest(METADATA_DIGEST);
        stored.metadata.insert(METADATA_DIGEST.to_owned(), digest);
        stored
    }

    #[test]
    fn the_averages_are_the_weights_and_the_generation_is_that_of_the_checkpoint() {
        let stored = stored();
        assert!(CheckpointFile::is_one(&stored) && !ModelWeights::is_one(&stored));
        let file = CheckpointFile::from_stored(&stored).unwrap();
        let said = file.to_string();
        assert!(said.starts_with("a training checkpoint at step 3 of 8 of \"the shortest\": "), "{said}");
        assert!(said.ends_with("weights of the model nano, their averages and the optimiser's moments"), "{said}");
        assert!(file.metadata_covered);
        for (name, tensor) in &file.weights.tensors.tensors {
            let averages = &stored.tensors[&format!("average/{name}")];
            assert_eq!(tensor.to_f32().unwrap(), averages.to_f32().unwrap(), "{name}");
        }
        let provenance = &file.weights.provenance;
        assert_eq!((provenance["steps"].as_str(), provenance["skipped-steps"].as_str()), ("3 of 8", "1"));
        assert!(provenance["data"].starts_with("1 × rooms train 0 to 0 at 256x256 ("), "{}", provenance["data"]);
        assert!(provenance["data"].ends_with(", generation 1)"), "{}", provenance["data"]);
        assert_eq!(provenance["data[0].source.rooms.generation"], "1");
        assert_eq!(provenance["background"], "[0.2, 0.4, 1.0]");
        assert!(!provenance.contains_key("step"), "of a checkpoint only");
        let mut older = stored;
        older.metadata.remove("data[0].source.rooms.generation");
        let older = CheckpointFile::from_stored(&with_digest(older)).unwrap();
        assert!(!older.weights.provenance["data"].contains("generation"), "not known");
    }

    #[test]
    fn what_is_not_as_written_is_an_error() {
        let said = |stored: &StoredTensors| CheckpointFile::from_stored(stored).unwrap_err().to_string();
        let mut damaged = stored();
        damaged.metadata.insert("step".to_owned(), "4".to_owned());
        assert!(said(&damaged).contains("expected the hash of the metadata"), "{}", said(&damaged));
        let mut other = stored();
        other.metadata.insert(MODEL.to_owned(), "00ff".to_owned());
        let other = said(&with_digest(other));
        assert!(other.contains("metadata model-sha256: expected 00ff, the network of the run, found "), "{other}");
    }
}
