//! How weights were made, as their file states it.

use std::collections::BTreeMap;

use atsplat_model::weights::training_data;

use crate::checkpoint::{InitialWeights, State};
use crate::{TrainConfig, TrainError};

/// The name of the normalisation of poses.
pub(crate) const POSE_NORMALISATION: &str = "pose-normalisation";
/// The name of the colour behind the Gaussians.
pub(crate) const BACKGROUND: &str = "background";

/// What a run's weights are made with, beyond its configuration.
pub(crate) struct MadeWith {
    /// Description of the samples.
    pub(crate) samples: String,
    /// The perceptual loss with its weights.
    pub(crate) perceptual: String,
    /// What the data's names stood for: hashes of presets and of lists of scenes, generations of the simulator.
    pub(crate) identities: BTreeMap<String, String>,
}

/// The background of a run, as evaluations write theirs, to compare it.
pub(crate) fn background(config: &TrainConfig) -> String {
    format!("{:?}", config.losses.background)
}

/// The provenance of a run's weights after its latest step.
///
/// # Errors
/// [`TrainError::Malformed`] for a configuration that TOML cannot represent.
pub(crate) fn provenance(
    config: &TrainConfig,
    state: &State,
    made_with: MadeWith,
) -> Result<BTreeMap<String, String>, TrainError> {
    let MadeWith { samples, perceptual, identities } = made_with;
    let entries = [
        ("title", config.title.clone()),
        ("seed", config.seed.to_string()),
        ("steps", format!("{} of {}", state.step, config.steps)),
        ("skipped-steps", state.skipped().to_string()),
        ("replaced-draws", state.replaced.to_string()),
        ("batch", config.batch.to_string()),
        ("perceptual-loss", perceptual),
        (POSE_NORMALISATION, config.pose_normalisation.name()),
        (BACKGROUND, background(config)),
        ("training-configuration", config.to_toml()?),
        ("version", env!("CARGO_PKG_VERSION").to_owned()),
    ];
    let mut provenance: BTreeMap<String, String> = entries.map(|(key, value)| (key.to_owned(), value)).into();
    provenance.extend(identities);
    let computed_by = [("adapter", &state.adapter), ("builds", &state.builds)];
    let computed_by = computed_by.into_iter().filter_map(|(key, value)| Some((key.to_owned(), value.clone()?)));
    provenance.extend(computed_by);
    let data = match &state.initial_weights {
        None => vec![("data", samples)],
        Some(InitialWeights { data: Some(before), .. }) => vec![("data", training_data::continued(&samples, before))],
        // From `data`, readers conclude what the network never saw.
        Some(InitialWeights { data: None, .. }) => {
            vec![("data-of-this-run", samples), ("data-before", "not stated".to_owned())]
        }
    };
    provenance.extend(data.into_iter().map(|(key, value)| (key.to_owned(), value)));
    if let Some(InitialWeights { sha256, differences, .. }) = &state.initial_weights {
        provenance.insert("initial-weights-sha256".to_owned(), sha256.clone());
        let differences = differences.iter().map(|text| ("initial-weights-differences".to_owned(), text.clone()));
        provenance.extend(differences);
    }
    Ok(provenance)
}
