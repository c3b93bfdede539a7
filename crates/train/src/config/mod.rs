//! Configuration of a run: one TOML file with everything that its weights depend on.

mod check;
mod derived;
mod held_out;
mod losses;
mod model;
mod notices;
mod scores;
mod windows;

use std::num::{NonZeroU32, NonZeroU64, NonZeroUsize};
use std::path::Path;

use atsplat_camera::{MeanCameraScale, PoseNormalisation};
use atsplat_files::malformed_toml;
use atsplat_model::network::MatmulPrecision;
use atsplat_scene::Warnings;
use serde::{Deserialize, Serialize};

pub(crate) use check::size_problem;
pub use losses::{LossConfig, PerceptualChoice};
pub use model::ModelChoice;

use crate::TrainError;
use crate::optimiser::{AdamW, Schedule};
use crate::samples::{DatasetConfig, DatasetSource, Mixture, RoomsConfig, RoomsSource, Source, ViewChoice};

pub(crate) const WHAT: &str = "training configuration";

/// A training run.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub struct TrainConfig {
    /// Title, one line.
    pub title: String,
    /// What readers of the run's numbers must know.
    #[serde(default)]
    pub notes: Vec<String>,
    /// Seed of initial weights, samples and random selection.
    pub seed: u64,
    /// Total number of optimiser steps.
    pub steps: NonZeroU64,
    /// Samples per step; their gradients are averaged. Those of micro-batches are summed as they come, so that more samples need no
    /// more memory.
    pub batch: NonZeroUsize,
    /// Samples per micro-batch: they go through the network as one batch. More are quicker, need more memory, and change the
    /// order of sums. On the CPU, as many micro-batches as there are threads are computed at once, and up to 256 MiB of their
    /// gradients wait to be summed, or one gradient for each thread if these are more; on a graphics adapter, one at a time.
    #[serde(default = "one", skip_serializing_if = "is_one")]
    pub micro_batch: NonZeroUsize,
    /// The network.
    pub model: ModelChoice,
    /// Normalisation of poses before they are given to the network.
    #[serde(default = "mean_camera")]
    pub pose_normalisation: PoseNormalisation,
    /// Sources of samples.
    pub data: Vec<DataConfig>,
    /// Whether half of the samples are mirrored.
    #[serde(default)]
    pub flips: bool,
    /// Number of distinct samples, after which they repeat; if absent, samples never repeat. Their gaps cannot warm up.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub distinct: Option<NonZeroU64>,
    /// Losses.
    #[serde(default)]
    pub losses: LossConfig,
    /// Optimiser.
    #[serde(default)]
    pub optimiser: AdamW,
    /// Schedule of the learning rate.
    #[serde(default)]
    pub schedule: Schedule,
    /// Largest norm of the gradient, to which it is clipped.
    #[serde(default = "unit")]
    pub clip: f64,
    /// Decay of an exponential moving average of the weights, such as 0.999: the run's weights and evaluations are then
    /// those of the average. If absent, they are those of the last step.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub average: Option<f64>,
    /// Precision of the network's matrix products during training. Weights, sums, losses and updates are always in f32, and so
    /// are evaluations.
    #[serde(default, skip_serializing_if = "is_default")]
    pub matmul_precision: MatmulPrecision,
    /// Evaluation during training.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub evaluation: Option<EvaluationConfig>,
    /// Checkpoints.
    #[serde(default)]
    pub checkpoints: CheckpointConfig,
    /// Number of steps skipped in a row that stops the run.
    #[serde(default = "five")]
    pub most_faults: NonZeroU32,
}

/// A source and its share of the samples.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub struct DataConfig {
    /// Share, relative to those of the other sources.
    #[serde(default = "unit")]
    pub share: f64,
    /// The source.
    pub source: SourceConfig,
}

/// A source of samples.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum SourceConfig {
    /// Simulated scenes.
    Rooms(RoomsConfig),
    /// A dataset on disk.
    Dataset(DatasetConfig),
}

/// Evaluation during training: scores of renders, and of the nearest context view as the baseline.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub struct EvaluationConfig {
    /// Steps between evaluations; the last step is always followed by one.
    pub every: NonZeroU64,
    /// Seed of the samples; if absent, that of the run. With one, runs with several seeds are compared on the same samples.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub seed: Option<u64>,
    /// Number of samples, the same in every evaluation. All are kept in memory, of which their images may need 8 GiB.
    pub samples: NonZeroU64,
    /// Their source.
    pub source: SourceConfig,
}

/// Checkpoints of a run.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields, default)]
pub struct CheckpointConfig {
    /// Steps between checkpoints: the most that a killed run loses.
    pub every: NonZeroU64,
    /// Number of latest checkpoints to keep.
    pub keep: NonZeroUsize,
}

impl Default for CheckpointConfig {
    fn default() -> Self {
        const { Self { every: NonZeroU64::new(500).unwrap(), keep: NonZeroUsize::new(2).unwrap() } }
    }
}

const fn mean_camera() -> PoseNormalisation {
    PoseNormalisation::mean_camera(MeanCameraScale::LongLrm)
}

const fn one() -> NonZeroUsize {
    NonZeroUsize::MIN
}

#[expect(clippy::trivially_copy_pass_by_ref, reason = "serde passes a reference")]
fn is_one(number: &NonZeroUsize) -> bool {
    *number == NonZeroUsize::MIN
}

#[expect(clippy::trivially_copy_pass_by_ref, reason = "serde passes a reference")]
fn is_default(precision: &MatmulPrecision) -> bool {
    *precision == MatmulPrecision::default()
}

const fn unit() -> f64 {
    1.0
}

const fn five() -> NonZeroU32 {
    const { NonZeroU32::new(5).unwrap() }
}

impl TrainConfig {
    /// The shortest configuration, for tests that change a field or two.
    #[cfg(test)]
    pub(crate) fn shortest() -> Self {
        let text = r#"
            title = "the shortest"
            seed = 1
            steps = 8
            batch = 3
            model = { base = "nano" }

            [[data]]
            [data.source.rooms]
            scenes-of = "rooms"
            scenes = 1
            size = [256, 256]
            views = { context = [2, 2], targets = 1, gaps = { min = 1, max = 2 } }
        "#;
        Self::from_toml(text).unwrap()
    }

    /// Reads a configuration; `base = "other.toml"`, relative to the file, names the configuration that it changes.
    ///
    /// # Errors
    /// [`TrainError::Io`]; [`TrainError::Malformed`] with file and field if the text is not a configuration or cannot
    /// train: views that no clip offers, images that the network's patches do not divide or of another scale than its
    /// resolution; [`TrainError::InFile`] around errors of the network's configuration and of presets.
    pub fn read(path: &Path) -> Result<Self, TrainError> {
        let config: Self = derived::read(path)?;
        let checked = config.validate().and_then(|()| config.check_model(&config.model.config()?));
        checked.map_err(|error| error.in_file(path))?;
        Ok(config)
    }

    /// Parses a configuration without a base.
    ///
    /// # Errors
    /// [`TrainError::Malformed`].
    pub fn from_toml(text: &str) -> Result<Self, TrainError> {
        let config: Self = toml::from_str(text).map_err(|error| malformed_toml(WHAT, derived::WHOLE, text, &error))?;
        config.validate()?;
        Ok(config)
    }

    /// The whole configuration, which [`Self::from_toml`] reads back.
    ///
    /// # Errors
    /// [`TrainError::Malformed`] for numbers that TOML cannot represent.
    pub fn to_toml(&self) -> Result<String, TrainError> {
        toml::to_string(self)
            .map_err(|error| TrainError::malformed(WHAT, "text", "values that TOML can represent", error))
    }

    fn validate(&self) -> Result<(), TrainError> {
        if self.matmul_precision == MatmulPrecision::F16 {
            let expected = "f32 or bf16: gradients can be too small for float16";
            return Err(TrainError::malformed(WHAT, "matmul-precision", expected, self.matmul_precision.name()));
        }
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

    /// Opens all sources of samples and adds what is wrong with them to `warnings`.
    ///
    /// # Errors
    /// As [`DatasetSource::open`] and [`Mixture::new`]; [`TrainError::Malformed`] for a dataset folder from which the
    /// reader would take test scenes; [`TrainError::InField`] if its `train` or `test` cannot be opened; [`TrainError::NoSample`] for a
    /// dataset whose first draws all give none, as if all images have a size on which the network does not train.
    pub fn samples(&self, warnings: &mut Warnings) -> Result<Mixture, TrainError> {
        for (at, data) in self.data.iter().enumerate() {
            if let SourceConfig::Dataset(dataset) = &data.source {
                let field = format!("data[{at}].source.dataset.path");
                dataset.require_one_split(field.clone()).map_err(|error| error.in_field(field))?;
            }
        }
        let (patch, model) = (self.distance_patch()?, self.model.config()?);
        let mut sources: Vec<(f64, Box<dyn Source>)> = Vec::new();
        for (at, DataConfig { share, source }) in self.data.iter().enumerate() {
            let opened: Box<dyn Source> = match source {
                SourceConfig::Rooms(_) => source.open(&self.pose_normalisation, patch, warnings)?,
                SourceConfig::Dataset(config) => {
                    let opened = DatasetSource::open(config.clone(), self.pose_normalisation.clone(), warnings);
                    let opened = opened.map_err(|error| error.below(&format!("data[{at}].source.dataset")))?;
                    let opened = opened.for_network(model.clone());
                    // Clips of simulated scenes were tried with the configuration; what a dataset contains is known only now.
                    opened.require_sample(self.seed)?;
                    Box::new(opened)
                }
            };
            sources.push((*share, opened));
        }
        Mixture::new(sources, self.flips, self.distinct.map(NonZeroU64::get))
    }
}

impl SourceConfig {
    /// How frames are chosen for a sample.
    pub(crate) const fn views(&self) -> &ViewChoice {
        match self {
            Self::Rooms(rooms) => &rooms.views,
            Self::Dataset(dataset) => &dataset.views,
        }
    }

    /// Opens the source and adds what is wrong with it to `warnings`. Samples of simulated scenes have exact distances of
    /// patches of `patch` pixels a side, if given.
    ///
    /// # Errors
    /// As [`DatasetSource::open`].
    pub fn open(
        &self,
        normalisation: &PoseNormalisation,
        patch: Option<NonZeroUsize>,
        warnings: &mut Warnings,
    ) -> Result<Box<dyn Source>, TrainError> {
        Ok(match self {
            Self::Rooms(config) => {
                let source = RoomsSource::new(config.clone(), normalisation.clone());
                Box::new(match patch {
                    Some(patch) => source.with_distances(patch),
                    None => source,
                })
            }
            Self::Dataset(config) => Box::new(DatasetSource::open(config.clone(), normalisation.clone(), warnings)?),
        })
    }
}
