use atsplat_model::network::{Network, Reconstruction};
use atsplat_model::{ImageSize, ModelConfig, ModelError};

use super::splatting::{Splatting, parameters};
use super::{Answer, Cost, Method, Question, Refusal};
use crate::{EvalError, MethodRecord, network_views};

/// Pixels of a picture from which on the paper's configuration for high resolution is meant: it uses it at 512×960, and not
/// at 256×448.
pub const HIGH_RESOLUTION: usize = 400_000;

/// ATSplat, in any variant.
#[derive(Debug)]
pub struct AtSplat {
    network: Network,
    /// Takes the place of `network` on large pictures.
    high_resolution: Option<Network>,
    splatting: Splatting,
    call_seed: u64,
    record: MethodRecord,
}

/// Where a network's weights came from.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum WeightsOf {
    /// A file with this SHA-256.
    File {
        /// In hexadecimal.
        sha256: String,
    },
    /// Nothing was learned.
    Random {
        /// What they were drawn with.
        seed: u64,
        /// SHA-256 of the file of a pretrained backbone, where there is one.
        backbone_sha256: Option<String>,
    },
}

impl AtSplat {
    /// A network with its weights. `name` is its name in the rows.
    ///
    /// # Errors
    /// [`EvalError::Model`] for a configuration that JSON cannot hold.
    pub fn new(
        name: &str,
        network: Network,
        weights: &WeightsOf,
        call_seed: u64,
        splatting: Splatting,
    ) -> Result<Self, EvalError> {
        let config = network.config();
        let untrained = matches!(weights, WeightsOf::Random { .. });
        let mut record = MethodRecord {
            name: name.to_owned(),
            kind: "atsplat".to_owned(),
            title: title(&config.name, None, untrained),
            parameters: parameters([
                ("model", config.name.clone().into()),
                ("model-hash", config.hash()?.into()),
                ("configuration", as_json(config)?),
                ("call-seed", call_seed.into()),
            ]),
            untrained,
            ..MethodRecord::default()
        };
        match weights {
            WeightsOf::File { sha256 } => record.weights_sha256 = Some(sha256.clone()),
            WeightsOf::Random { seed, backbone_sha256 } => {
                record.parameters.insert("weights-seed".to_owned(), (*seed).into());
                if let Some(hash) = backbone_sha256 {
                    record.parameters.insert("backbone-sha256".to_owned(), hash.clone().into());
                }
            }
        }
        if let Some(size) = network.trained_size() {
            record.parameters.insert("context-at-scale-of".to_owned(), size.to_string().into());
        }
        splatting.describe(&mut record);
        Ok(Self { network, high_resolution: None, splatting, call_seed, record })
    }

    /// The same with another network for pictures of [`HIGH_RESOLUTION`] pixels and more: what the paper's configuration for
    /// them makes of the same weights.
    ///
    /// # Errors
    /// [`EvalError::Settings`] for a configuration that JSON cannot hold.
    pub fn with_high_resolution(mut self, network: Network) -> Result<Self, EvalError> {
        self.record.parameters.insert("high-resolution".to_owned(), as_json(network.config())?);
        self.high_resolution = Some(network);
        Ok(self)
    }

    /// The same, told apart in tables and plots by what it changes of its weights' own configuration.
    #[must_use]
    pub fn variant(mut self, name: &str) -> Self {
        self.record.title = title(&self.network.config().name, Some(name), self.record.untrained);
        self
    }

    fn reconstruct(&self, question: &Question<'_>) -> Result<(Reconstruction, Option<String>), Refusal> {
        let cameras = question.trial.context().iter().map(|view| view.camera).collect();
        let views =
            network_views(question.pictures.iter().map(AsRef::as_ref), cameras).map_err(|error| refusal(&error))?;
        let network = self.network_for(views.size());
        let made = network.reconstruct(&views, self.call_seed).map_err(|error| refusal(&error))?;
        let note = (made.seen_at != views.size())
            .then(|| format!("the network saw context pictures of {} at {}", views.size(), made.seen_at));
        Ok((made, note))
    }

    /// Large pictures go to the configuration for high resolution, whose coarse branch sees them at half their size, where
    /// that is what the weights were trained at.
    fn network_for(&self, size: ImageSize) -> &Network {
        let half = ImageSize::new(size.height / 2, size.width / 2);
        let is_large = size.height.saturating_mul(size.width) >= HIGH_RESOLUTION && self.network.sees(half) == half;
        self.high_resolution.as_ref().filter(|_| is_large).unwrap_or(&self.network)
    }
}

/// What tables call it: the paper's own configurations need no name.
fn title(config: &str, variant: Option<&str>, untrained: bool) -> String {
    let config = (!config.starts_with("paper-")).then_some(config);
    let told: Vec<&str> = config.into_iter().chain(variant).chain(untrained.then_some("untrained")).collect();
    if told.is_empty() { "ATSplat".to_owned() } else { format!("ATSplat ({})", told.join(", ")) }
}

/// The whole configuration: a table that asks for a variant reads it.
fn as_json(config: &ModelConfig) -> Result<serde_json::Value, EvalError> {
    serde_json::to_value(config).map_err(|error| EvalError::Settings {
        what: "configuration",
        expected: "values that JSON can hold".to_owned(),
        found: error.to_string(),
    })
}

impl Method for AtSplat {
    fn record(&self) -> MethodRecord {
        self.record.clone()
    }

    fn is_heavy(&self) -> bool {
        true
    }

    fn begin<'a>(&'a self, question: Question<'a>) -> Result<Box<dyn Answer + 'a>, Refusal> {
        let (made, note) = self.reconstruct(&question)?;
        let stages = made.seconds.stages().map(|(name, secs)| (name.to_owned(), secs));
        let cost = Cost {
            initial_tokens: Some(made.budget.initial_tokens as u64),
            final_tokens: Some(made.budget.final_tokens as u64),
            stages: stages.into_iter().collect(),
            peak_bytes: Some(made.memory.peak_bytes()),
            notes: note.into_iter().collect(),
            ..Cost::default()
        };
        Ok(self.splatting.answer(question, made.gaussians, cost))
    }
}

fn refusal(error: &ModelError) -> Refusal {
    match error {
        ModelError::Indivisible { .. } | ModelError::SizesDiffer { .. } => Refusal::NotApplicable(error.to_string()),
        _ => Refusal::Failed(error.to_string()),
    }
}
