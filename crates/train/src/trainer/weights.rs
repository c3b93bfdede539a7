//! What a run writes: checkpoints and weights, with how they were made.

use std::path::PathBuf;

use atsplat_model::weights::{ModelWeights, Precision};

use super::{Trainer, WEIGHTS};
use crate::TrainError;
use crate::parameters::Parameters;
use crate::provenance::{MadeWith, provenance};

/// The least number that f16 rounds to infinity.
const BEYOND_F16: f32 = 65520.0;

impl Trainer {
    /// Writes a checkpoint and, unless all steps so far were skipped, the weights; returns the checkpoint's path.
    ///
    /// # Errors
    /// As [`crate::Checkpoints::write`]; [`TrainError::Diverged`] for weights beyond the range of f16: nothing is written then, so that
    /// the checkpoints before remain.
    pub fn write_checkpoint(&self) -> Result<PathBuf, TrainError> {
        let state = self.current_state();
        let result = state.result();
        if let Some((tensor, value)) = beyond_f16(&result) {
            let (step, last_checkpoint) = (state.step, self.checkpoints.last()?);
            return Err(TrainError::Diverged { step, tensor, value, last_checkpoint });
        }
        let path = self.checkpoints.write(&state, &self.config)?;
        if self.is_untrained() {
            return Ok(path);
        }
        let made_with = MadeWith {
            samples: self.samples.name(),
            perceptual: self.objective.perceptual(),
            identities: self.checkpoints.resolved().of_data(),
        };
        let provenance = provenance(&self.config, &self.state, made_with)?;
        let weights = ModelWeights::new(self.model.clone(), provenance, &result.stored()?)?;
        weights.write(&self.folder.join(WEIGHTS), Precision::Half)?;
        Ok(path)
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
