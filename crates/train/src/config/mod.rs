//! Configuration of a run: one TOML file says all that its weights depend on.

mod check;
mod derived;
mod losses;
mod model;

use std::num::{NonZeroU32, NonZeroU64, NonZeroUsize};
use std::path::Path;

use atsplat_camera::{MeanCameraScale, PoseNormalisation};
use atsplat_scene::Warnings;
use serde::{Deserialize, Serialize};

pub use losses::{LossConfig, PerceptualChoice};
pub use model::ModelChoice;

use crate::TrainError;
use crate::optimiser::{AdamW, Schedule};
use crate::samples::{DatasetConfig, DatasetSource, Mixture, RoomsConfig, RoomsSource, Source};

pub(crate) const WHAT: &str = "training configuration";

/// A training run.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub struct TrainConfig {
    /// One line for people.
    pub title: String,
    /// What a reader of its numbers must know.
    #[serde(default)]
    pub notes: Vec<String>,
    /// What weights, samples and random selection start from.
    pub seed: u64,
    /// Optimiser steps in all.
    pub steps: NonZeroU64,
    /// Samples of a step; their gradients are averaged, so any number fits into memory.
    pub batch: NonZeroUsize,
    /// Which network.
    pub model: ModelChoice,
    /// What happens to poses before the network sees them.
    #[serde(default = "mean_camera")]
    pub pose_normalisation: PoseNormalisation,
    /// Where samples come from.
    pub data: Vec<DataConfig>,
    /// Whether half of the samples are mirrored.
    #[serde(default)]
    pub flips: bool,
    /// After so many samples they repeat; without it they never do.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub distinct: Option<NonZeroU64>,
    /// What is minimised.
    #[serde(default)]
    pub losses: LossConfig,
    /// How parameters move.
    #[serde(default)]
    pub optimiser: AdamW,
    /// How fast.
    #[serde(default)]
    pub schedule: Schedule,
    /// Gradients longer than this are shortened to it.
    #[serde(default = "unit")]
    pub clip: f64,
    /// Decay of an exponential moving average of the weights, such as 0.999: the run's weights and evaluations are then the
    /// average's. Without it they are those of the last step.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub average: Option<f64>,
    /// What is measured on the way.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub evaluation: Option<EvaluationConfig>,
    /// What is kept on the way.
    #[serde(default)]
    pub checkpoints: CheckpointConfig,
    /// So many steps in a row that had to be skipped stop the run.
    #[serde(default = "five")]
    pub most_faults: NonZeroU32,
}

/// A source and its share of the samples.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub struct DataConfig {
    /// Relative to the shares of the others.
    #[serde(default = "unit")]
    pub share: f64,
    /// Where samples come from.
    pub source: SourceConfig,
}

/// Where samples come from.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum SourceConfig {
    /// Simulated scenes.
    Rooms(RoomsConfig),
    /// A dataset on disk.
    Dataset(DatasetConfig),
}

/// What is measured on the way: PSNR of renders, and of the nearest context view in their place.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub struct EvaluationConfig {
    /// Steps between evaluations; the last step is followed by one in any case.
    pub every: NonZeroU64,
    /// Samples, always the same.
    pub samples: NonZeroU64,
    /// Where they come from.
    pub source: SourceConfig,
}

/// What is kept on the way.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields, default)]
pub struct CheckpointConfig {
    /// Steps between checkpoints: the most that a killed run loses.
    pub every: NonZeroU64,
    /// How many of the last are kept.
    pub keep: NonZeroUsize,
}

impl Default for CheckpointConfig {
    fn default() -> Self {
        Self {
            every: NonZeroU64::new(500).unwrap_or(NonZeroU64::MIN),
            keep: NonZeroUsize::new(2).unwrap_or(NonZeroUsize::MIN),
        }
    }
}

const fn mean_camera() -> PoseNormalisation {
    PoseNormalisation::mean_camera(MeanCameraScale::LongLrm)
}

const fn unit() -> f64 {
    1.0
}

const fn five() -> NonZeroU32 {
    match NonZeroU32::new(5) {
        Some(five) => five,
        None => NonZeroU32::MIN,
    }
}

impl TrainConfig {
    /// Reads a configuration; `base = "other.toml"`, relative to it, names one that it changes.
    ///
    /// # Errors
    /// [`TrainError::Io`]; [`TrainError::Malformed`] with file and field for text that is no configuration and for one
    /// that cannot train: views that no clip offers, pictures that the network's patches do not divide.
    pub fn read(path: &Path) -> Result<Self, TrainError> {
        let config: Self = derived::read(path)?;
        config.validate().and_then(|()| config.check_sizes()).map_err(|error| error.in_file(path))?;
        Ok(config)
    }

    /// Reads a configuration that stands for itself.
    ///
    /// # Errors
    /// [`TrainError::Malformed`].
    pub fn from_toml(text: &str) -> Result<Self, TrainError> {
        let config: Self = toml::from_str(text)
            .map_err(|error| TrainError::malformed(WHAT, "text", "a training configuration", error))?;
        config.validate()?;
        Ok(config)
    }

    /// The whole configuration, which [`Self::from_toml`] reads back.
    ///
    /// # Errors
    /// [`TrainError::Malformed`] for numbers that TOML does not have.
    pub fn to_toml(&self) -> Result<String, TrainError> {
        toml::to_string(self).map_err(|error| TrainError::malformed(WHAT, "text", "what TOML can say", error))
    }

    fn validate(&self) -> Result<(), TrainError> {
        let numbers = [
            ("clip", self.clip),
            ("schedule.learning-rate", self.schedule.learning_rate),
            ("optimiser.epsilon", self.optimiser.epsilon),
        ];
        for (field, value) in numbers {
            if !(value > 0.0 && value.is_finite()) {
                return Err(TrainError::malformed(WHAT, field, "a positive number", value));
            }
        }
        for (field, beta) in ["optimiser.betas[0]", "optimiser.betas[1]"].into_iter().zip(self.optimiser.betas) {
            if !(0.0..1.0).contains(&beta) {
                return Err(TrainError::malformed(WHAT, field, "a number from 0 to below 1", beta));
            }
        }
        if let Some(decay) = self.average.filter(|decay| !(0.0..1.0).contains(decay)) {
            return Err(TrainError::malformed(WHAT, "average", "a number from 0 to below 1", decay));
        }
        let shares = [
            ("optimiser.weight-decay", self.optimiser.weight_decay, f64::MAX, "a number of at least 0"),
            ("schedule.final-share", self.schedule.final_share, 1.0, "a number from 0 to 1"),
        ];
        for (field, value, most, expected) in shares {
            if !(0.0..=most).contains(&value) {
                return Err(TrainError::malformed(WHAT, field, expected, value));
            }
        }
        self.losses.validate()?;
        self.check_sources()
    }

    /// Opens all sources of samples.
    ///
    /// # Errors
    /// As [`DatasetSource::open`] and [`Mixture::new`].
    pub fn samples(&self, warnings: &mut Warnings) -> Result<Mixture, TrainError> {
        let sources =
            self.data.iter().map(|data| Ok((data.share, data.source.open(&self.pose_normalisation, warnings)?)));
        Mixture::new(sources.collect::<Result<_, TrainError>>()?, self.flips, self.distinct.map(NonZeroU64::get))
    }
}

impl SourceConfig {
    /// Opens the source.
    ///
    /// # Errors
    /// As [`DatasetSource::open`].
    pub fn open(
        &self,
        normalisation: &PoseNormalisation,
        warnings: &mut Warnings,
    ) -> Result<Box<dyn Source>, TrainError> {
        Ok(match self {
            Self::Rooms(config) => Box::new(RoomsSource::new(config.clone(), normalisation.clone())),
            Self::Dataset(config) => Box::new(DatasetSource::open(config.clone(), normalisation.clone(), warnings)?),
        })
    }
}
