//! What a run writes: checkpoints and weights, with how they were made.

use std::collections::BTreeMap;
use std::path::PathBuf;

use atsplat_model::weights::{ModelWeights, Precision};

use super::initial_weights::POSE_NORMALISATION;
use super::{Trainer, WEIGHTS};
use crate::TrainError;
use crate::checkpoint::InitialWeights;
use crate::parameters::Parameters;

/// The least number that f16 rounds to infinity.
const BEYOND_F16: f32 = 65520.0;

impl Trainer {
    /// Writes a checkpoint and the weights; returns the checkpoint's path.
    ///
    /// # Errors
    /// As [`crate::Checkpoints::write`]; [`TrainError::Diverged`] for weights beyond the range of f16: nothing is written then, so that
    /// the checkpoints before remain.
    pub fn write_checkpoint(&self) -> Result<PathBuf, TrainError> {
        let state = self.current_state()?;
        let result = state.result();
        if let Some((tensor, value)) = beyond_f16(&result) {
            let (step, last_checkpoint) = (state.step, self.checkpoints.last()?);
            return Err(TrainError::Diverged { step, tensor, value, last_checkpoint });
        }
        let path = self.checkpoints.write(&state, &self.config)?;
        let weights = ModelWeights::new(self.model.clone(), self.provenance()?, &result.stored()?)?;
        weights.write(&self.folder.join(WEIGHTS), Precision::Half)?;
        Ok(path)
    }

    /// How the weights were made.
    fn provenance(&self) -> Result<BTreeMap<String, String>, TrainError> {
        let entries = [
            ("title", self.config.title.clone()),
            ("seed", self.config.seed.to_string()),
            ("steps", format!("{} of {}", self.state.step, self.config.steps)),
            ("skipped-steps", self.state.skipped().to_string()),
            ("replaced-draws", self.state.replaced.to_string()),
            ("batch", self.config.batch.to_string()),
            ("perceptual-loss", self.objective.perceptual()),
            (POSE_NORMALISATION, self.config.pose_normalisation.name()),
            ("training-configuration", self.config.to_toml()?),
            ("version", env!("CARGO_PKG_VERSION").to_owned()),
        ];
        let mut provenance: BTreeMap<String, String> = entries.map(|(key, value)| (key.to_owned(), value)).into();
        if let Some(adapter) = &self.state.adapter {
            provenance.insert("adapter".to_owned(), adapter.clone());
        }
        let samples = self.samples.name();
        let data = match &self.state.initial_weights {
            None => vec![("data", samples)],
            Some(InitialWeights { data: Some(before), .. }) => vec![("data", format!("{samples}; before: {before}"))],
            // From `data`, readers conclude what the network never saw.
            Some(InitialWeights { data: None, .. }) => {
                vec![("data-of-this-run", samples), ("data-before", "not stated".to_owned())]
            }
        };
        provenance.extend(data.into_iter().map(|(key, value)| (key.to_owned(), value)));
        if let Some(InitialWeights { sha256, differences, .. }) = &self.state.initial_weights {
            provenance.insert("initial-weights-sha256".to_owned(), sha256.clone());
            let differences = differences.iter().map(|text| ("initial-weights-differences".to_owned(), text.clone()));
            provenance.extend(differences);
        }
        Ok(provenance)
    }
}

/// The first parameter with a finite value beyond the range of f16, and the value.
pub(super) fn beyond_f16(parameters: &Parameters) -> Option<(String, f32)> {
    let mut all = parameters.list().iter().zip(parameters.values());
    all.find_map(|(parameter, values)| {
        let value = value_beyond_f16(values)?;
        Some((parameter.name.clone(), value))
    })
}

/// The first finite value beyond the range of f16.
pub(super) fn value_beyond_f16(values: &[f32]) -> Option<f32> {
    values.iter().copied().find(|value| value.is_finite() && value.abs() >= BEYOND_F16)
}
