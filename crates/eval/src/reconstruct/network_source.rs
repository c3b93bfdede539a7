use std::collections::BTreeMap;
use std::path::PathBuf;

use atsplat_files::Sha256Digest;
use atsplat_model::network::{Device, Network};
use atsplat_model::parameters::parameters;
use atsplat_model::weights::{ModelWeights, TensorFile, generated, read_backbone};
use atsplat_model::{ImageSize, ModelConfig, ModelError};
use atsplat_results::TrainingRecord;
use serde::Serialize;

use crate::method::{TrainedUnder, WeightsSource};

/// A network configuration and the location of its weights, which are not loaded yet.
#[derive(Debug)]
pub struct NetworkSource {
    /// The configuration that runs; the weights may have been written for another one.
    pub config: ModelConfig,
    /// The configuration for large images, if the network has another one for them.
    high_resolution: Option<ModelConfig>,
    weights: Weights,
    /// Whether the network sees images as given instead of at the training resolution of its weights.
    sees_as_given: bool,
}

#[derive(Debug)]
enum Weights {
    File { path: PathBuf, file: TensorFile, written_for: Box<ModelConfig> },
    Untrained { seed: u64, backbone: Option<UntrainedBackbone> },
}

/// The file of a trained backbone for an untrained network.
#[derive(Clone, Debug)]
pub struct UntrainedBackbone {
    /// DINOv2 weights.
    pub path: PathBuf,
    /// Expected hash of the file.
    pub sha256: Option<Sha256Digest>,
}

/// The configuration that ran.
#[derive(Debug, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct ModelRecord {
    /// Name of the configuration.
    pub name: String,
    /// Hash of everything that can change a Gaussian.
    pub hash: String,
    /// The configuration of the weights file, if another one ran.
    pub written_for: Option<WrittenFor>,
}

/// The configuration that a weights file was written for.
#[derive(Debug, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct WrittenFor {
    /// Name of the configuration in the weights file.
    pub name: String,
    /// [`ModelConfig::hash`] of that configuration.
    pub hash: String,
}

/// Origin of the network's weights.
#[derive(Debug, Serialize)]
#[serde(tag = "kind", rename_all = "kebab-case", rename_all_fields = "kebab-case")]
pub enum WeightsRecord {
    /// From a weights file.
    File {
        /// Path as given by the user.
        file: PathBuf,
        /// Of the whole file, in hexadecimal.
        sha256: String,
        /// What the file says about its origin.
        provenance: BTreeMap<String, String>,
    },
    /// Random weights.
    Untrained {
        /// The same seed gives the same weights.
        seed: u64,
        /// The warning that must accompany them.
        message: &'static str,
        /// The trained backbone, if any.
        backbone: Option<BackboneRecord>,
    },
}

/// The file of a backbone.
#[derive(Debug, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct BackboneRecord {
    /// Path as given by the user.
    pub file: PathBuf,
    /// Of the whole file.
    pub sha256: Sha256Digest,
    /// Description of the published file with this hash, if any.
    pub known: Option<&'static str>,
}

impl WeightsRecord {
    /// The form that is recorded in a results store.
    pub fn weights(&self) -> WeightsSource {
        match self {
            Self::File { sha256, .. } => WeightsSource::File { sha256: sha256.clone() },
            Self::Untrained { seed, backbone, .. } => {
                let backbone_sha256 = backbone.as_ref().map(|backbone| backbone.sha256.to_string());
                WeightsSource::Random { seed: *seed, backbone_sha256 }
            }
        }
    }

    /// What the weights were trained under, if their file says so.
    pub fn trained_under(&self) -> TrainedUnder {
        match self {
            Self::File { provenance, .. } => TrainedUnder::of(provenance),
            Self::Untrained { .. } => TrainedUnder::default(),
        }
    }

    /// How the weights were trained, if their file says so.
    pub fn training(&self) -> Option<TrainingRecord> {
        match self {
            Self::File { provenance, .. } => TrainingRecord::of(provenance),
            Self::Untrained { .. } => None,
        }
    }

    const UNTRAINED: &str =
        "random weights: the Gaussians show that the pipeline works and what it costs, but not the scene";

    /// The warning that must accompany all output of an untrained network.
    pub const fn untrained(&self) -> Option<&'static str> {
        match self {
            Self::File { .. } => None,
            Self::Untrained { message, .. } => Some(message),
        }
    }
}

impl NetworkSource {
    /// The weights of a file, which was written for the configuration `written_for`.
    pub fn from_file(config: ModelConfig, path: PathBuf, file: TensorFile, written_for: ModelConfig) -> Self {
        Self::new(config, Weights::File { path, file, written_for: Box::new(written_for) })
    }

    /// Random weights.
    pub const fn untrained(config: ModelConfig, seed: u64) -> Self {
        Self::new(config, Weights::Untrained { seed, backbone: None })
    }

    /// Random weights with a trained backbone.
    pub const fn untrained_with_backbone(config: ModelConfig, seed: u64, backbone: UntrainedBackbone) -> Self {
        Self::new(config, Weights::Untrained { seed, backbone: Some(backbone) })
    }

    const fn new(config: ModelConfig, weights: Weights) -> Self {
        Self { config, high_resolution: None, weights, sees_as_given: false }
    }

    /// Adds the configuration for large images, which evaluations use ([`crate::method::AtSplat::with_high_resolution`]).
    #[must_use]
    pub fn with_high_resolution(self, config: Option<ModelConfig>) -> Self {
        Self { high_resolution: config, ..self }
    }

    /// The configuration for large images, unless the network sees images as given.
    pub fn high_resolution(&self) -> Option<&ModelConfig> {
        self.high_resolution.as_ref().filter(|_| self.trained_at().is_some())
    }

    /// The same network, but it sees images as given, not at the training resolution of its weights.
    #[must_use]
    pub fn without_resizing(self) -> Self {
        Self { sees_as_given: true, ..self }
    }

    /// The training resolution of the weights, unless the network sees images as given.
    fn trained_at(&self) -> Option<ImageSize> {
        match &self.weights {
            Weights::File { written_for, .. } if !self.sees_as_given => Some(written_for.resolution),
            _ => None,
        }
    }

    /// The size at which the network sees images of a given size, in pixels.
    pub fn input_size(&self, given: ImageSize) -> ImageSize {
        self.trained_at().map_or(given, |trained| self.config.context_size(given, trained))
    }

    /// Loads the network with all its weights.
    ///
    /// # Errors
    /// [`ModelError`] if a file is broken, or its weights do not fit the configuration.
    pub fn load(&self, device: &Device) -> Result<(Network, WeightsRecord), ModelError> {
        let network = Network::new(&self.config, device)?;
        let network = match self.trained_at() {
            Some(size) => network.trained_at(size),
            None => network,
        };
        match &self.weights {
            Weights::File { path, file, .. } => {
                // Several configurations can share the same parameters.
                let weights = ModelWeights::of_file(file)?
                    .for_network(self.config.clone())
                    .map_err(|error| error.in_file(path))?;
                let record = WeightsRecord::File {
                    file: path.clone(),
                    sha256: file.sha256.to_string(),
                    provenance: weights.provenance,
                };
                Ok((network.with_weights(&weights.tensors)?, record))
            }
            Weights::Untrained { seed, backbone } => {
                let mut tensors = generated(&parameters(&self.config), *seed);
                let mut record = None;
                if let Some(UntrainedBackbone { path, sha256 }) = backbone {
                    let backbone = read_backbone(path, &self.config, *sha256)?;
                    tensors.tensors.extend(backbone.tensors.tensors);
                    let known = backbone.known.map(|known| known.what);
                    record = Some(BackboneRecord { file: path.clone(), sha256: backbone.sha256, known });
                }
                let message = WeightsRecord::UNTRAINED;
                let record = WeightsRecord::Untrained { seed: *seed, message, backbone: record };
                Ok((network.with_weights(&tensors)?, record))
            }
        }
    }

    /// Records the configuration.
    ///
    /// # Errors
    /// [`ModelError`] if the configuration cannot be hashed.
    pub fn record(&self) -> Result<ModelRecord, ModelError> {
        let hash = self.config.hash()?;
        let of_weights = match &self.weights {
            Weights::File { written_for, .. } => {
                Some(WrittenFor { name: written_for.name.clone(), hash: written_for.hash()? })
            }
            Weights::Untrained { .. } => None,
        };
        let written_for = of_weights.filter(|config| config.hash != hash);
        Ok(ModelRecord { name: self.config.name.clone(), hash, written_for })
    }
}
