use std::path::Path;
use std::sync::Arc;

use atsplat_model::network::Network;
use atsplat_model::parameters::parameters;
use atsplat_model::weights::{ModelWeights, StoredTensor, StoredTensors, TensorFile, generated};
use atsplat_model::{ImageSize, ModelConfig, ModelError};
use atsplat_results::TrainingRecord;
use atsplat_splat::effects::{EffectPlan, EffectSelection};

use super::{Overrides, Setting, Sweep};
use crate::method::{
    AtSplat, ChangedConstants, ConstantsChoice, MAX_GAUSSIANS, Method, Optimised, Splatting, TrainedUnder,
    WeightsSource,
};
use crate::runner::Dataset;
use crate::{ComputeDevice, EvalError};

/// The base setting of a sweep, before any override is applied.
#[derive(Clone, Debug)]
pub struct SweepBase {
    /// The network of settings without weights of their own, with [`Self::changes`]; `None` is for sweeps whose settings run none
    /// ([`Overrides::runs_network`]).
    pub network: Option<SweepNetwork>,
    /// Changes of configurations that apply to the networks of all settings, before a setting's own.
    pub changes: Overrides,
    /// Whether the networks of settings with weights of their own use images as they are too.
    pub sees_as_given: bool,
    /// Seed of random token selection.
    pub call_seed: u64,
    /// Renderer constants.
    pub constants: ConstantsChoice,
    /// Background RGB; `None` uses the protocol's.
    pub background: Option<[f64; 3]>,
    /// Where networks run and Gaussians are rendered.
    pub device: ComputeDevice,
}

/// A network of a sweep, before the overrides of a setting.
#[derive(Clone, Debug)]
pub struct SweepNetwork {
    /// Its configuration.
    pub config: ModelConfig,
    /// That for large images, if the network has another one for them ([`AtSplat::with_high_resolution`]).
    pub high_resolution: Option<ModelConfig>,
    /// Its weights.
    pub tensors: StoredTensors,
    /// Where they came from.
    pub weights: WeightsSource,
    /// How they were trained, if their file says so.
    pub training: Option<TrainingRecord>,
    /// What they were trained under, if their file says so.
    pub trained_under: TrainedUnder,
    /// Image size that the weights were trained at, to which the network resizes images; `None` uses images as
    /// they are.
    pub trained_at: Option<ImageSize>,
}

/// Settings with the same images and views, which form one plan of the runner.
#[derive(Debug)]
pub struct Part {
    /// Protocols, with the part's resolution and number of views.
    pub datasets: Vec<Dataset>,
    /// One method per setting, named by its label.
    pub methods: Vec<Arc<dyn Method>>,
}

/// Expands a sweep into plans of the runner that fill one store, in the order of the sweep.
///
/// # Errors
/// [`EvalError::Settings`] for an invalid override, and for a setting that runs the base's network, if there is none;
/// [`EvalError::Model`] for weights that do not match the network.
pub fn parts(sweep: &Sweep, base: &SweepBase, datasets: &[Dataset]) -> Result<Vec<Part>, EvalError> {
    let mut parts: Vec<(&Overrides, Part)> = Vec::new();
    for setting in &sweep.settings {
        let method = base.method(setting).map_err(|error| error.in_setting(&setting.label))?;
        let same_trials = |overrides: &Overrides| {
            (overrides.views, overrides.resolution) == (setting.overrides.views, setting.overrides.resolution)
        };
        if let Some((_, part)) = parts.iter_mut().find(|(overrides, _)| same_trials(overrides)) {
            part.methods.push(method);
        } else {
            let modified =
                |dataset| modified(dataset, &setting.overrides).map_err(|error| error.in_setting(&setting.label));
            let datasets = datasets.iter().map(modified).collect::<Result<_, _>>()?;
            parts.push((&setting.overrides, Part { datasets, methods: vec![method] }));
        }
    }
    Ok(parts.into_iter().map(|(_, part)| part).collect())
}

impl SweepBase {
    /// The method at a setting.
    fn method(&self, setting: &Setting) -> Result<Arc<dyn Method>, EvalError> {
        let overrides = &setting.overrides;
        let (splatting, budget) = (self.splatting(overrides)?, overrides.budget()?);
        if let (Some(strategy), Some(budget)) = (overrides.strategy, budget) {
            let (name, seed) = (Some(setting.label.as_str()), self.call_seed);
            return Ok(Arc::new(Optimised::from_scratch(name, strategy, budget, MAX_GAUSSIANS, seed, splatting)));
        }
        let network = match &overrides.weights {
            None => self.network.clone().ok_or_else(|| EvalError::Settings {
                what: "weights",
                expected: "those of the network that the setting runs".to_owned(),
                found: "none".to_owned(),
            })?,
            Some(path) => self.network_of(path)?,
        };
        let SweepNetwork { config, high_resolution, tensors, weights, training, trained_under, trained_at } = network;
        let config = overrides.model(&config)?;
        let tensors = adapted(&config, tensors, &weights)?;
        let network = Network::new(&config, &self.device.network()?)?.with_weights(&tensors)?;
        // Images in a resolution of the sweep are not resized for the network.
        let network = match trained_at.filter(|_| overrides.resolution.is_none()) {
            Some(size) => network.trained_at(size),
            None => network,
        };
        let precision = overrides.matmul_precision(&network)?;
        let is_resizing = network.trained_size().is_some();
        let large_images =
            high_resolution.filter(|_| is_resizing).map(|config| overrides.model(&config)).transpose()?;
        let (name, seed) = (setting.label.as_str(), self.call_seed);
        if let Some(budget) = budget {
            let method = Optimised::refined(Some(name), network, &weights, budget, seed, splatting)?;
            let method = method.with_training(training, trained_under);
            return Ok(Arc::new(method.with_high_resolution(large_images)?));
        }
        let method = AtSplat::new(name, network, &weights, seed, splatting)?
            .with_training(training, trained_under)
            .with_matmul_precision(precision);
        Ok(Arc::new(method.with_high_resolution(large_images)?))
    }

    /// The network of a weights file, with the changes of the base.
    fn network_of(&self, path: &Path) -> Result<SweepNetwork, EvalError> {
        let file = TensorFile::open(path)?;
        let in_file = |source| ModelError::InFile { path: path.to_owned(), source: Box::new(source) };
        let read = ModelWeights::from_stored(&file.stored).map_err(in_file)?;
        let large_images = read.config.for_high_resolution().map_err(in_file)?;
        Ok(SweepNetwork {
            config: self.changes.model(&read.config)?,
            high_resolution: large_images.map(|config| self.changes.model(&config)).transpose()?,
            tensors: read.tensors,
            weights: WeightsSource::File { sha256: file.sha256.to_string() },
            training: TrainingRecord::of(&read.provenance),
            trained_under: TrainedUnder::of(&read.provenance),
            trained_at: (!self.sees_as_given).then_some(read.config.resolution),
        })
    }

    fn splatting(&self, overrides: &Overrides) -> Result<Splatting, EvalError> {
        let constants = if overrides.renderer.is_empty() {
            self.constants.clone()
        } else {
            ConstantsChoice::Changed(ChangedConstants::new(overrides.renderer.clone())?)
        };
        let tolerance = overrides.effects_tolerance()?.unwrap_or(EffectPlan::TOLERANCE);
        let (background, effects) = (self.background, EffectSelection::Auto);
        Ok(Splatting { constants, background, effects, tolerance, ..self.device.splatting() })
    }
}

/// Adapts weights to another K. Random tensors of another shape are generated again. Trained weights keep the first K
/// Gaussians of each token, which are rows of the head's last layer; there cannot be more than they have. Their places do not
/// change ([`atsplat_model::config::HeadConfig::keeping_first`]).
pub(super) fn adapted(
    config: &ModelConfig,
    tensors: StoredTensors,
    weights: &WeightsSource,
) -> Result<StoredTensors, EvalError> {
    let WeightsSource::Random { seed, .. } = weights else { return first_gaussians(config, tensors) };
    let mut drawn = generated(&parameters(config), *seed);
    for (name, tensor) in tensors.tensors {
        if drawn.tensors.get(&name).is_none_or(|drawn| drawn.shape() == tensor.shape()) {
            drawn.tensors.insert(name, tensor);
        }
    }
    Ok(drawn)
}

fn first_gaussians(config: &ModelConfig, mut tensors: StoredTensors) -> Result<StoredTensors, EvalError> {
    for parameter in parameters(config).iter().filter(|parameter| parameter.name.starts_with("head.")) {
        let Some(tensor) = tensors.tensors.get_mut(&parameter.name) else { continue };
        let ([expected, columns @ ..], [found, others @ ..]) = (&parameter.shape[..], tensor.shape()) else { continue };
        if columns != others || expected == found {
            continue;
        }
        if expected > found {
            let count = config.head.gaussians_per_token;
            return Err(EvalError::Settings {
                what: "gaussians-per-token",
                expected: format!("at most as many as the weights have, or separate `weights` for {count}"),
                found: format!("{found} rows of {}", parameter.name),
            });
        }
        let values = tensor.to_f32()?;
        // Fewer rows of the same columns: always a prefix of the values.
        *tensor = StoredTensor::from_f32(parameter.shape.clone(), &values[..parameter.elements()])?;
    }
    Ok(tensors)
}

/// The dataset with the overrides' resolution and views.
fn modified(dataset: &Dataset, overrides: &Overrides) -> Result<Dataset, EvalError> {
    let Dataset { name, preset, source, description, index } = dataset;
    let index = index.clone().reduced_to(overrides.index(&index.index, name)?);
    let views = overrides.views.map(|views| format!("-{views}-views"));
    let resolution = overrides.resolution.map(|[height, width]| format!("-{height}x{width}"));
    let name = [Some(name.clone()), views, resolution].into_iter().flatten().collect();
    Ok(Dataset {
        name,
        preset: overrides.preset(preset)?,
        source: Arc::clone(source),
        description: description.clone(),
        index,
    })
}
