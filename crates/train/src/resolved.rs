use std::collections::BTreeMap;

use atsplat_model::ModelConfig;
use atsplat_model::weights::StoredTensors;
use atsplat_protocol::Preset;
use atsplat_rooms::GENERATION;

use crate::samples::Source;
use crate::{Objective, SourceConfig, TrainConfig, TrainError};

/// Identities of what a configuration only names: the network, the perceptual loss with its weights, presets, the simulator, and the
/// lists of a dataset's scenes. Checkpoints contain them, and a run resumes with no others, although the configuration still names them
/// in the same way.
#[derive(Clone, Debug, Default)]
pub struct Resolved {
    /// Key in a checkpoint's metadata, and identity.
    entries: Vec<(String, String)>,
}

/// The key in a checkpoint's metadata of the hash of the network's configuration.
pub(crate) const MODEL: &str = "model-sha256";
/// The key of the perceptual loss.
pub(crate) const PERCEPTUAL: &str = "perceptual-loss";

/// Those identities in a checkpoint's metadata that are of data. The network is in a weights file itself.
pub(crate) fn of_data<'a>(entries: impl Iterator<Item = (&'a String, &'a String)>) -> BTreeMap<String, String> {
    let is_of_data = |key: &str| key.starts_with("data[") || key.starts_with("evaluation.source.");
    entries.filter(|(key, _)| is_of_data(key)).map(|(key, value)| (key.clone(), value.clone())).collect()
}

/// The key of the generation of the simulator that rendered a source's scenes.
pub(crate) fn generation_key(field: &str) -> String {
    format!("{field}.rooms.generation")
}

impl Resolved {
    /// The identities as of now.
    ///
    /// # Errors
    /// [`TrainError::InField`] for a preset that cannot be read, and errors of hashes.
    pub fn new(config: &TrainConfig, model: &ModelConfig, objective: &Objective) -> Result<Self, TrainError> {
        let mut entries = vec![
            (MODEL.to_owned(), model.hash()?),
            // The hash is that of what can change a Gaussian.
            ("model-resolution".to_owned(), model.resolution.to_string()),
            (PERCEPTUAL.to_owned(), objective.perceptual()),
        ];
        for (field, source) in config.sources() {
            entries.push(match source {
                SourceConfig::Dataset(dataset) => {
                    let preset = Preset::resolve(&dataset.preset)
                        .map_err(|error| TrainError::from(error).in_field(format!("{field}.dataset.preset")))?;
                    (format!("{field}.dataset.preset-sha256"), preset.hash()?.to_string())
                }
                SourceConfig::Rooms(_) => (generation_key(&field), GENERATION.to_string()),
            });
        }
        Ok(Self { entries })
    }

    /// The same with the lists of scenes that samples of the training and of the evaluation are drawn from: in a longer list, the same
    /// draw is of another scene.
    #[must_use]
    pub fn with_scenes(mut self, samples: &dyn Source, evaluation: Option<&dyn Source>) -> Self {
        let of_training = samples.scene_lists().into_iter();
        let of_evaluation = evaluation.into_iter().flat_map(Source::scene_lists);
        let of_evaluation = of_evaluation.map(|(field, sha256)| (format!("evaluation.source.{field}"), sha256));
        self.entries.extend(of_training.chain(of_evaluation).map(|(field, sha256)| (field, sha256.to_string())));
        self
    }

    /// Those of the data, by their keys.
    pub(crate) fn of_data(&self) -> BTreeMap<String, String> {
        of_data(self.entries.iter().map(|entry| (&entry.0, &entry.1)))
    }

    /// Adds the identities to a checkpoint's metadata.
    pub(crate) fn add_to(&self, stored: &mut StoredTensors) {
        stored.metadata.extend(self.entries.iter().cloned());
    }

    /// An error for a checkpoint of a run with other identities; one of an earlier version does not state them.
    pub(crate) fn check(&self, stored: &StoredTensors) -> Result<(), TrainError> {
        for (key, found) in &self.entries {
            if let Some(recorded) = stored.metadata.get(key).filter(|recorded| *recorded != found) {
                let expected = format!(
                    "{recorded}, as in the run so far, or a new run from its weights in another folder (`--init`)"
                );
                return Err(TrainError::malformed("checkpoint", key, expected, found));
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const CONFIG: &str = "
        title = 'a preset by path'
        seed = 1
        steps = 8
        batch = 3
        model = { base = 'micro' }
        [[data]]
        source.rooms = { scenes-of = 'rooms', scenes = 1, size = [128, 128], views = VIEWS }
        [[data]]
        source.dataset = { path = 'absent', preset = 'PRESET', views = VIEWS }
    ";
    const VIEWS: &str = "{ context = [2, 2], targets = 1, gaps = { min = 1, max = 2 } }";

    #[test]
    fn another_model_loss_preset_or_simulator_is_an_error() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("preset.toml");
        let text = Preset::text_of("rooms-2v-128").unwrap().replace("name = \"rooms-2v-128\"", "name = \"mine\"");
        std::fs::write(&path, &text).unwrap();
        let config = CONFIG.replace("VIEWS", VIEWS).replace("PRESET", &path.to_string_lossy());
        let config = TrainConfig::from_toml(&config).unwrap();
        let (model, objective) = (config.model.config().unwrap(), Objective::new(config.losses.clone()).unwrap());
        let now = |model: &ModelConfig| Resolved::new(&config, model, &objective).unwrap();
        let mut stored = StoredTensors::default();
        now(&model).check(&stored).unwrap();
        now(&model).add_to(&mut stored);
        assert_eq!(stored.metadata.len(), 5);
        now(&model).check(&stored).unwrap();

        let rejects = |resolved: &Resolved, stored: &StoredTensors, key: &str| {
            let error = resolved.check(stored).unwrap_err().to_string();
            let advice = format!("expected {}, as in the run so far, or a new run from", stored.metadata[key]);
            assert!(error.contains(key) && error.contains(&advice), "{key}: {error}");
        };
        let larger = ModelConfig { resolution: atsplat_model::ImageSize::new(256, 256), ..model.clone() };
        rejects(&now(&larger), &stored, "model-resolution");
        rejects(&now(&model.with_expansion_in_first(1)), &stored, "model-sha256");
        let mut other_loss = stored.clone();
        other_loss.metadata.insert("perceptual-loss".to_owned(), "lpips, weights 00ff".to_owned());
        rejects(&now(&model), &other_loss, "perceptual-loss");
        let mut other_images = stored.clone();
        other_images.metadata.insert("data[0].source.rooms.generation".to_owned(), "1".to_owned());
        rejects(&now(&model), &other_images, "data[0].source.rooms.generation");
        other_images.metadata.retain(|key, _| !key.ends_with("generation"));
        now(&model).check(&other_images).unwrap();

        std::fs::write(&path, text.replace("title = \"", "title = \"Renamed: ")).unwrap();
        now(&model).check(&stored).unwrap();
        let changed = text.replace("principal-point = \"frozen\"", "principal-point = \"corrected\"");
        assert_ne!(changed, text);
        std::fs::write(&path, changed).unwrap();
        rejects(&now(&model), &stored, "data[1].source.dataset.preset-sha256");
    }
}
