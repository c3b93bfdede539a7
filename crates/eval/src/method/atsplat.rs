use std::sync::{Arc, OnceLock};

use atsplat_model::network::{MatmulPrecision, Network, Reconstruction, Views};
use atsplat_model::{ImageSize, ModelConfig, ModelError};
use atsplat_results::{MethodRecord, TrainingRecord, TrialNote};

use super::splatting::{Splatting, parameters};
use super::{Cost, Method, MethodError, Prediction, SharedEncoding, Timed, TrainedUnder, TrialInput, trial_seed};
use crate::{EvalError, adapter_record};

/// ATSplat in any variant.
#[derive(Debug)]
pub struct AtSplat {
    network: Network,
    /// Used instead of `network` for large images.
    large_images: Option<LargeImages>,
    splatting: Splatting,
    matmul_precision: MatmulPrecision,
    /// Combined with the trial's identity into the seed of each forward pass.
    call_seed: u64,
    record: MethodRecord,
    trained_under: TrainedUnder,
    shared: Option<Arc<SharedEncoding>>,
}

/// The same weights under the configuration for large images.
#[derive(Debug)]
pub(super) struct LargeImages {
    config: ModelConfig,
    /// Made for the first such image.
    network: OnceLock<Network>,
}

impl LargeImages {
    /// States the configuration in the method's record.
    pub(super) fn recorded(config: ModelConfig, record: &mut MethodRecord) -> Result<Self, EvalError> {
        record.parameters.insert("high-resolution".to_owned(), as_json(&config)?);
        Ok(Self { config, network: OnceLock::new() })
    }

    /// The network for images of this size: `network`, unless they are large for it and it has another one for these.
    pub(super) fn network_for<'a>(
        large_images: Option<&'a Self>,
        network: &'a Network,
        size: ImageSize,
    ) -> Result<&'a Network, ModelError> {
        let is_large = |trained_at| network.config().has_high_resolution(size, trained_at);
        let large_images = large_images.filter(|_| network.trained_size().is_some_and(is_large));
        let Some(Self { config, network: known }) = large_images else { return Ok(network) };
        if let Some(known) = known.get() {
            return Ok(known);
        }
        let made = Network::new(config, &network.device())?.with_weights(&network.weights()?)?;
        Ok(known.get_or_init(|| made))
    }
}

/// Where a network's weights came from.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum WeightsSource {
    /// A weights file.
    File {
        /// Its SHA-256 in hexadecimal.
        sha256: String,
    },
    /// Random initialisation; untrained.
    Random {
        /// The initialisation's seed.
        seed: u64,
        /// SHA-256 of the pretrained backbone's file, if one was used.
        backbone_sha256: Option<String>,
    },
}

impl WeightsSource {
    /// Adds a network with these weights to a method's record: its configuration, which weights they are, and the size at whose
    /// scale it sees context images.
    ///
    /// # Errors
    /// [`EvalError::Model`] for a configuration that cannot be hashed.
    pub(super) fn describe(&self, network: &Network, record: &mut MethodRecord) -> Result<(), EvalError> {
        let config = network.config();
        record.record_model(&config.name, &config.hash()?);
        match self {
            Self::File { sha256 } => record.weights_sha256 = Some(sha256.clone()),
            Self::Random { seed, backbone_sha256 } => {
                record.record_random_weights(*seed, backbone_sha256.as_deref());
            }
        }
        if let Some(size) = network.trained_size() {
            record.parameters.insert("context-at-scale-of".to_owned(), size.to_string().into());
        }
        Ok(())
    }
}

impl AtSplat {
    /// A network with its weights. `name` is the method's name in the rows; random token expansion draws from `call_seed`
    /// and the trial's identity.
    ///
    /// # Errors
    /// [`EvalError::Model`] and [`EvalError::Settings`] for a configuration that JSON cannot represent.
    pub fn new(
        name: &str,
        network: Network,
        weights: &WeightsSource,
        call_seed: u64,
        splatting: Splatting,
    ) -> Result<Self, EvalError> {
        let config = network.config();
        let untrained = matches!(weights, WeightsSource::Random { .. });
        let mut record = MethodRecord {
            name: name.to_owned(),
            kind: "atsplat".to_owned(),
            title: title(&config.name, None, untrained),
            parameters: parameters([("call-seed", call_seed.into())]),
            ..MethodRecord::default()
        };
        record.record_configuration(as_json(config)?);
        weights.describe(&network, &mut record)?;
        splatting.describe(&mut record);
        record.record_network(network.adapter().as_ref().map(adapter_record));
        let matmul_precision = MatmulPrecision::default();
        Ok(Self {
            network,
            large_images: None,
            splatting,
            matmul_precision,
            call_seed,
            record,
            trained_under: TrainedUnder::default(),
            shared: None,
        })
    }

    /// Adds the configuration for large images ([`ModelConfig::has_high_resolution`]), which the same weights fit
    /// ([`ModelConfig::for_high_resolution`]), if there is one.
    ///
    /// # Errors
    /// [`EvalError::Settings`] for a configuration that JSON cannot represent.
    pub fn with_high_resolution(mut self, config: Option<ModelConfig>) -> Result<Self, EvalError> {
        self.large_images = config.map(|config| LargeImages::recorded(config, &mut self.record)).transpose()?;
        Ok(self)
    }

    /// Computes matrix products in this precision, which the record states unless it is f32; in f32 where the network's device
    /// does not have it ([`Network::supports_precision`]).
    #[must_use]
    pub fn with_matmul_precision(mut self, precision: MatmulPrecision) -> Self {
        if precision != MatmulPrecision::default() {
            self.record.parameters.insert("matmul-precision".to_owned(), precision.name().into());
        }
        self.matmul_precision = precision;
        self
    }

    /// Records how the weights were trained. Trials under something else than `under` get notes.
    #[must_use]
    pub fn with_training(mut self, training: Option<TrainingRecord>, under: TrainedUnder) -> Self {
        (self.record.training, self.trained_under) = (training, under);
        self
    }

    /// Adds the variant to the record, for differences that the configuration does not show.
    #[must_use]
    pub fn with_recorded_variant(mut self, variant: &str) -> Self {
        self.record.record_variant(variant);
        self
    }

    /// Records that its thresholds are these quantiles of its scores, instead of the published thresholds.
    #[must_use]
    pub fn with_thresholds_at(mut self, quantiles: &[f64], published: &[f64]) -> Self {
        self.record.record_threshold_quantiles(quantiles, published);
        self
    }

    /// Sets the variant's name in tables and plots: what differs from the configuration stored with the weights.
    #[must_use]
    pub fn with_variant_title(mut self, name: &str) -> Self {
        self.record.title = title(&self.network.config().name, Some(name), self.record.untrained);
        self
    }

    /// Takes encoded scenes from others with the same weights and precision, if they have the same encoder; its encoding is then
    /// not timed.
    #[must_use]
    pub(crate) fn sharing(mut self, shared: &Arc<SharedEncoding>) -> Self {
        self.shared = shared.serves(self.network.config()).then(|| Arc::clone(shared));
        self
    }

    fn reconstruct(&self, input: &TrialInput<'_>) -> Result<(Reconstruction, Vec<String>), MethodError> {
        let views = context_views(input)?;
        let seed = trial_seed(self.call_seed, input.trial);
        let size = views.size();
        let network = self.network_for(size).map_err(|error| method_error(&error))?;
        let reconstruction = self.matmul_precision.scope(|| match &self.shared {
            Some(shared) => shared.reconstruct(network, views, seed),
            None => network.reconstruct(&views, seed),
        });
        let reconstruction = reconstruction.map_err(|error| method_error(&error))?;
        let input_size = reconstruction.input_size;
        let resized = (input_size != size)
            .then(|| TrialNote::SawResized { sizes: &format!("{size} at {input_size}") }.to_string());
        let other = self.trained_under.notes(input, self.setting(), &self.splatting);
        Ok((reconstruction, resized.into_iter().chain(other).collect()))
    }

    /// Large images use the configuration for high resolution.
    fn network_for(&self, size: ImageSize) -> Result<&Network, ModelError> {
        LargeImages::network_for(self.large_images.as_ref(), &self.network, size)
    }
}

/// The trial's context views as the input of a network.
pub(super) fn context_views(input: &TrialInput<'_>) -> Result<Views, MethodError> {
    let cameras = input.trial.context().iter().map(|view| view.camera).collect();
    Views::of_images(input.images.iter().map(AsRef::as_ref), cameras).map_err(|error| method_error(&error))
}

/// Title in tables; the paper's own configurations are not named.
fn title(config: &str, variant: Option<&str>, untrained: bool) -> String {
    let config = (!config.starts_with("paper-")).then_some(config);
    let details: Vec<&str> = config.into_iter().chain(variant).chain(untrained.then_some("untrained")).collect();
    if details.is_empty() { "ATSplat".to_owned() } else { format!("ATSplat ({})", details.join(", ")) }
}

/// The whole configuration, which tables use to identify variants.
fn as_json(config: &ModelConfig) -> Result<serde_json::Value, EvalError> {
    serde_json::to_value(config).map_err(|error| EvalError::Settings {
        what: "configuration",
        expected: "values that JSON can represent".to_owned(),
        found: error.to_string(),
    })
}

impl Method for AtSplat {
    fn record(&self) -> MethodRecord {
        self.record.clone()
    }

    fn runs_alone(&self) -> bool {
        true
    }

    fn timed(&self) -> Timed {
        Timed { encoding: self.shared.is_none(), rendering: true }
    }

    fn predict<'a>(&'a self, input: TrialInput<'a>) -> Result<Box<dyn Prediction + 'a>, MethodError> {
        let (reconstruction, notes) = self.reconstruct(&input)?;
        let stages = reconstruction.seconds.stages().map(|(name, secs)| (name.to_owned(), secs));
        let cost = Cost {
            initial_tokens: Some(reconstruction.budget.initial_tokens as u64),
            final_tokens: Some(reconstruction.budget.final_tokens as u64),
            stages: stages.into_iter().collect(),
            peak_bytes: Some(reconstruction.memory.peak_bytes()),
            notes,
            ..Cost::default()
        };
        Ok(self.splatting.predict(input, reconstruction.gaussians, cost))
    }
}

/// An input that the network does not take does not count as a failure.
pub(super) fn method_error(error: &ModelError) -> MethodError {
    match error {
        ModelError::Indivisible { .. } | ModelError::SizesDiffer { .. } => {
            MethodError::NotApplicable(error.to_string())
        }
        _ => MethodError::Failed(error.to_string()),
    }
}

#[cfg(test)]
pub(super) mod tests {
    use atsplat_model::config::{Selection, Upsampling};
    use atsplat_model::network::Device;
    use atsplat_model::parameters::parameters;
    use atsplat_model::weights::generated;
    use atsplat_pixels::ImageU8;
    use atsplat_protocol::trial::{Prefetch, Trial, TrialRecipe, Trials};
    use atsplat_protocol::{IndexFile, Preset};

    use super::*;
    use crate::sources::simulated;

    /// Context of two simulated rooms; the first room has the same entry twice.
    pub(in super::super) fn trials(preset: &Preset) -> Vec<(Trial, Vec<Arc<ImageU8>>)> {
        let mut index = IndexFile::embedded("rooms-2v").unwrap().unwrap().index;
        index.scenes.truncate(2);
        let entries = &mut index.scenes[0];
        entries.truncate(1);
        entries.push(entries[0].clone());
        let source = Arc::new(simulated(preset, &index).unwrap().unwrap());
        let trials = Trials::new(source, &index, TrialRecipe::of(preset, "ATSplat"), Prefetch::NONE).take(3);
        let with_images = |trial: Trial| {
            let images = trial.context().iter().map(|view| view.image().unwrap()).collect();
            (trial, images)
        };
        trials.map(|trial| with_images(trial.unwrap().0)).collect()
    }

    fn method(selection: Option<Selection>, call_seed: u64) -> AtSplat {
        let mut config = ModelConfig::named("nano").unwrap();
        config.expansion.selection = selection.unwrap_or(config.expansion.selection);
        let network = Network::new(&config, &Device::flex()).unwrap();
        let network = network.with_weights(&generated(&parameters(&config), 1)).unwrap();
        let weights = WeightsSource::Random { seed: 1, backbone_sha256: None };
        AtSplat::new("atsplat", network, &weights, call_seed, Splatting::default()).unwrap()
    }

    /// Of two images that are large, the weights see the half of one as it is.
    #[test]
    fn large_images_have_a_configuration_of_their_own() {
        let sized = |side: usize| {
            let AtSplat { network, splatting, .. } = method(None, 0);
            let network = network.trained_at(ImageSize::new(side, 480));
            let weights = WeightsSource::File { sha256: "00".to_owned() };
            AtSplat::new("atsplat", network, &weights, 0, splatting).unwrap()
        };
        let high = ModelConfig::named("nano").unwrap().for_high_resolution().unwrap();
        assert!(high.is_some());
        let downscale = |method: &AtSplat, height: usize, width: usize| {
            method.network_for(ImageSize::new(height, width)).unwrap().config().coarse.image_downscale
        };
        let method = sized(256).with_high_resolution(high.clone()).unwrap();
        let first = [downscale(&method, 512, 960), downscale(&method, 768, 960), downscale(&method, 256, 480)];
        assert_eq!((first, downscale(&method, 512, 960)), ([2, 1, 1], 2), "and the same network again");
        let weights = |size| method.network_for(size).unwrap().weights().unwrap().digest();
        assert_eq!(weights(ImageSize::new(512, 960)), weights(ImageSize::new(64, 64)));
        assert_eq!(method.record().parameters["high-resolution"], serde_json::to_value(&high).unwrap());
        assert_eq!(
            downscale(&sized(256).with_high_resolution(None).unwrap(), 512, 960),
            1,
            "not without the configuration"
        );
        assert_eq!(downscale(&sized(128).with_high_resolution(high).unwrap(), 512, 960), 1);
    }

    #[test]
    fn trials_under_another_pose_normalisation_or_background_get_a_note() {
        let preset = Preset::named("rooms-2v-128").unwrap();
        let (trial, images) = &trials(&preset)[0];
        let evaluated = preset.setting_for("ATSplat").pose_normalisation.name();
        let notes = |provenance: &[(&str, &str)], background: Option<[f64; 3]>| {
            let provenance = provenance.iter().map(|(key, value)| ((*key).to_owned(), (*value).to_owned()));
            let mut method = method(None, 0).with_training(None, TrainedUnder::of(&provenance.collect()));
            method.splatting.background = background;
            method.reconstruct(&TrialInput { preset: &preset, trial, images }).unwrap().1
        };
        let (none, blue) = ([""; 0], Some([0.0, 0.25, 1.0]));
        assert_eq!(notes(&[], None), none);
        assert_eq!(notes(&[], blue), none, "trained by a version that did not state it");
        let (poses, background) = ("pose-normalisation", "background");
        assert_eq!(notes(&[(poses, evaluated.as_str()), (background, "[0.0, 0.0, 0.0]")], None), none);
        assert_eq!(notes(&[(background, "[0.0, 0.25, 1.0]")], blue), none);
        let expected = format!("trained with the pose normalisation baseline-one, evaluated with {evaluated}");
        assert_eq!(notes(&[(poses, "baseline-one")], None), [expected]);
        let expected = "trained on the background [0.2, 0.4, 0.6], evaluated on [0.0, 0.0, 0.0]";
        assert_eq!(notes(&[(background, "[0.2, 0.4, 0.6]")], None), [expected]);
        let expected = "trained on the background [0.0, 0.0, 0.0], evaluated on [0.0, 0.25, 1.0]";
        assert_eq!(notes(&[(background, "[0.0, 0.0, 0.0]")], blue), [expected]);
    }

    /// Whichever method encodes a scene, and in whichever order scenes come.
    #[test]
    fn sharing_encodings_changes_no_bit_and_no_other_network_takes_part() {
        let preset = Preset::named("rooms-2v-128").unwrap();
        let trials = trials(&preset);
        let gaussians = |method: &AtSplat, at: usize| {
            let (trial, images) = &trials[at];
            method.reconstruct(&TrialInput { preset: &preset, trial, images }).unwrap().0.gaussians
        };
        let selections = [Selection::FarthestPoint {}, Selection::Random { seed: 3 }];
        let shared = Arc::new(SharedEncoding::of(method(None, 0).network.config()));
        let sharing = selections.map(|selection| method(Some(selection), 0).sharing(&shared));
        let alone = selections.map(|selection| method(Some(selection), 0));
        for at in [0, 2, 1, 2] {
            for (sharing, alone) in sharing.iter().zip(&alone) {
                assert_eq!(sharing.timed(), Timed::RENDERING);
                assert_eq!(gaussians(sharing, at), gaussians(alone, at), "trial {at}");
            }
            assert_ne!(gaussians(&alone[0], at), gaussians(&alone[1], at), "the selections differ");
        }
        let mut config = ModelConfig::named("nano").unwrap();
        config.fine.upsampling = Upsampling::Nearest;
        assert!(!shared.serves(&config), "another fine branch");
    }

    #[test]
    fn random_expansion_differs_between_trials_and_is_reproducible() {
        let preset = Preset::named("rooms-2v-128").unwrap();
        let trials = trials(&preset);
        let selected = |method: &AtSplat, at: usize| -> Vec<Vec<usize>> {
            let (trial, images) = &trials[at];
            let input = TrialInput { preset: &preset, trial, images };
            method.reconstruct(&input).unwrap().0.blocks.into_iter().map(|block| block.selected).collect()
        };
        let random = method(Some(Selection::Random { seed: 3 }), 0);
        let forwards = [0, 1, 2].map(|at| selected(&random, at));
        assert!(forwards[0].iter().any(|block| !block.is_empty()), "nothing was expanded");
        assert_ne!(forwards[0], forwards[1], "two entries of a scene");
        assert_ne!(forwards[0], forwards[2], "two scenes");
        let mut backwards = [2, 1, 0].map(|at| selected(&method(Some(Selection::Random { seed: 3 }), 0), at));
        backwards.reverse();
        assert_eq!(forwards, backwards, "a rerun in another order");
        assert_ne!(selected(&method(Some(Selection::Random { seed: 3 }), 1), 0), forwards[0], "another call seed");
        // Without random selection neither the call seed nor the trial's identity matters.
        let scored = selected(&method(None, 0), 0);
        assert_eq!((&scored, &scored), (&selected(&method(None, 1), 0), &selected(&method(None, 0), 1)));
    }
}
