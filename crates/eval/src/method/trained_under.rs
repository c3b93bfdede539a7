use std::collections::BTreeMap;

use atsplat_results::{TRAINED_BACKGROUND, TRAINED_POSES};

use super::{Splatting, TrialInput};

/// What a network's training gave it and compared its renders with, as far as the file of its weights says so.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct TrainedUnder {
    /// Name of the pose normalisation.
    pub poses: Option<String>,
    /// Background of the renders, such as `[0.0, 0.5, 1.0]`.
    pub background: Option<String>,
}

impl TrainedUnder {
    /// From a weights file's provenance.
    pub fn of(provenance: &BTreeMap<String, String>) -> Self {
        let entry = |key: &str| provenance.get(key).cloned();
        Self { poses: entry(TRAINED_POSES), background: entry(TRAINED_BACKGROUND) }
    }

    /// Notes for a trial in which something differs from the training.
    pub(super) fn notes(&self, input: &TrialInput<'_>, setting: &str, splatting: &Splatting) -> Vec<String> {
        let poses = input.preset.setting_for(setting).pose_normalisation.name();
        let background = format!("{:?}", splatting.background_of(input));
        let mut notes = Vec::new();
        if let Some(trained) = self.poses.as_ref().filter(|trained| **trained != poses) {
            notes.push(format!("trained with the pose normalisation {trained}, evaluated with {poses}"));
        }
        if let Some(trained) = self.background.as_ref().filter(|trained| **trained != background) {
            notes.push(format!("trained on the background {trained}, evaluated on {background}"));
        }
        notes
    }
}
