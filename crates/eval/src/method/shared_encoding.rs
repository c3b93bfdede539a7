use std::sync::{Mutex, MutexGuard, PoisonError};

use atsplat_model::network::{EncodedScene, Network, Reconstruction, Views};
use atsplat_model::{ModelConfig, ModelError};

/// The latest encoded scene of networks with the same weights that differ in token expansion alone, so that each scene is encoded
/// once for all of them.
#[derive(Debug)]
pub(crate) struct SharedEncoding {
    config: ModelConfig,
    latest: Mutex<Option<(Views, EncodedScene)>>,
}

impl SharedEncoding {
    /// For networks that encode like this configuration.
    pub(crate) fn of(config: &ModelConfig) -> Self {
        Self { config: config.clone(), latest: Mutex::default() }
    }

    /// Whether a network of this configuration can use it, given that it has the same weights.
    pub(crate) fn serves(&self, config: &ModelConfig) -> bool {
        self.config.encodes_like(config)
    }

    /// [`Network::reconstruct`], to the same bits.
    pub(super) fn reconstruct(
        &self,
        network: &Network,
        views: Views,
        call_seed: u64,
    ) -> Result<Reconstruction, ModelError> {
        let known = self.lock().as_ref().filter(|(encoded, _)| *encoded == views).map(|(_, scene)| scene.clone());
        // Encoding while locked could wait for itself: its threads may begin another trial.
        let scene = if let Some(scene) = known {
            scene
        } else {
            let scene = network.encode_scene(&views)?;
            *self.lock() = Some((views, scene.clone()));
            scene
        };
        network.reconstruct_encoded(scene, call_seed)
    }

    fn lock(&self) -> MutexGuard<'_, Option<(Views, EncodedScene)>> {
        self.latest.lock().unwrap_or_else(PoisonError::into_inner)
    }
}
