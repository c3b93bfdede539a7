use atsplat_files::Sha256Digest;
use std::sync::Arc;

use atsplat_model::network::{Device, Network};
use atsplat_model::parameters::parameters;
use atsplat_model::weights::{ModelWeights, StoredTensor, StoredTensors, TensorFile, generated};
use atsplat_model::{ImageSize, ModelConfig, ModelError};
use atsplat_protocol::IndexLayout;
use atsplat_splat::effects::EffectSelection;

use super::{Knobs, Setting, Sweep};
use crate::EvalError;
use crate::method::{AtSplat, ChangedConstants, ConstantsChoice, Method, Splatting, WeightsOf};
use crate::runner::{Dataset, PlannedIndex};

/// The network that is swept, as it is where no knob is turned.
#[derive(Clone, Debug)]
pub struct Swept {
    /// Its configuration.
    pub config: ModelConfig,
    /// Its weights.
    pub tensors: StoredTensors,
    /// Where they came from.
    pub weights: WeightsOf,
    /// What size of pictures they were trained at, and the network therefore sees; `None` shows it pictures as they are.
    pub trained_at: Option<ImageSize>,
    /// What random selection of tokens draws with.
    pub call_seed: u64,
    /// Rules of the rasterizer.
    pub constants: ConstantsChoice,
    /// RGB behind everything; `None` takes the protocol's.
    pub background: Option<[f64; 3]>,
}

/// Settings that run on the same pictures and views: one plan of the runner.
#[derive(Debug)]
pub struct Part {
    /// Protocols, with the part's resolution and number of views.
    pub datasets: Vec<Dataset>,
    /// One method for each setting, under its label.
    pub methods: Vec<Arc<dyn Method>>,
}

/// A sweep as plans of the runner that fill one store, in the order of the sweep.
///
/// # Errors
/// [`EvalError::Settings`] for a knob that does not fit, before anything runs; [`EvalError::Model`] for weights that do not
/// fit the network.
pub fn parts(sweep: &Sweep, swept: &Swept, datasets: &[Dataset]) -> Result<Vec<Part>, EvalError> {
    let mut parts: Vec<(&Knobs, Part)> = Vec::new();
    for setting in &sweep.settings {
        let method = swept.method(setting)?;
        let asks_the_same =
            |knobs: &Knobs| (knobs.views, knobs.resolution) == (setting.knobs.views, setting.knobs.resolution);
        if let Some((_, part)) = parts.iter_mut().find(|(knobs, _)| asks_the_same(knobs)) {
            part.methods.push(method);
        } else {
            let changed = |dataset| changed(dataset, &setting.knobs);
            let datasets = datasets.iter().map(changed).collect::<Result<_, _>>()?;
            parts.push((&setting.knobs, Part { datasets, methods: vec![method] }));
        }
    }
    Ok(parts.into_iter().map(|(_, part)| part).collect())
}

impl Swept {
    /// The network at a setting.
    fn method(&self, setting: &Setting) -> Result<Arc<dyn Method>, EvalError> {
        let knobs = &setting.knobs;
        let (config, tensors, weights, trained_at) = match &knobs.weights {
            None => (knobs.model(&self.config)?, self.tensors.clone(), self.weights.clone(), self.trained_at),
            Some(path) => {
                let file = TensorFile::open(path)?;
                let in_file = |source| ModelError::InFile { path: path.clone(), source: Box::new(source) };
                let read = ModelWeights::from_stored(&file.stored).map_err(in_file)?;
                let trained_at = self.trained_at.map(|_| read.config.resolution);
                (knobs.model(&read.config)?, read.tensors, WeightsOf::File { sha256: file.sha256 }, trained_at)
            }
        };
        let tensors = fitting(&config, tensors, &weights)?;
        let network = Network::new(&config, &Device::flex())?.with_weights(&tensors)?;
        // Where a sweep asks for a resolution, the network is meant to see it.
        let network = match trained_at.filter(|_| knobs.resolution.is_none()) {
            Some(size) => network.trained_at(size),
            None => network,
        };
        let constants = if knobs.renderer.is_empty() {
            self.constants.clone()
        } else {
            ConstantsChoice::Changed(ChangedConstants::new(knobs.renderer.clone())?)
        };
        let splatting =
            Splatting { constants, background: self.background, effects: EffectSelection::All, ..Splatting::default() };
        Ok(Arc::new(AtSplat::new(&setting.label, network, &weights, self.call_seed, splatting)?))
    }
}

/// Weights for another K. Random ones are as good for any: those that fit stay, the others are drawn again. Of trained ones the
/// first K Gaussians of each token stay, as many rows of the head's last layer; they cannot be made more.
fn fitting(config: &ModelConfig, tensors: StoredTensors, weights: &WeightsOf) -> Result<StoredTensors, EvalError> {
    let WeightsOf::Random { seed, .. } = weights else { return first_gaussians(config, tensors) };
    let mut drawn = generated(&parameters(config), *seed);
    for (name, tensor) in tensors.tensors {
        let fits = drawn.tensors.get(&name).is_none_or(|drawn| drawn.shape() == tensor.shape());
        if fits {
            drawn.tensors.insert(name, tensor);
        }
    }
    Ok(drawn)
}

fn first_gaussians(config: &ModelConfig, mut tensors: StoredTensors) -> Result<StoredTensors, EvalError> {
    for parameter in parameters(config).iter().filter(|parameter| parameter.name.starts_with("head.")) {
        let Some(tensor) = tensors.tensors.get_mut(&parameter.name) else { continue };
        let ([wanted, columns @ ..], [there, others @ ..]) = (&parameter.shape[..], tensor.shape()) else { continue };
        if columns != others || wanted == there {
            continue;
        }
        if wanted > there {
            let (wanted, there) = (config.head.gaussians_per_token, format!("{there} rows of {}", parameter.name));
            return Err(EvalError::Settings {
                what: "gaussians-per-token",
                expected: format!("at most as many as the weights have, or `weights` of their own for {wanted}"),
                found: there,
            });
        }
        let values = tensor.to_f32()?;
        let kept = values.get(..parameter.elements()).unwrap_or(&values);
        *tensor = StoredTensor::from_f32(parameter.shape.clone(), kept)?;
    }
    Ok(tensors)
}

/// The dataset as the knobs want its pictures and views.
fn changed(dataset: &Dataset, knobs: &Knobs) -> Result<Dataset, EvalError> {
    let Dataset { name, preset, source, told, index } = dataset;
    let asked = knobs.index(&index.index)?;
    let index = if knobs.views.is_none() {
        index.clone()
    } else {
        PlannedIndex {
            sha256: Sha256Digest::of(asked.to_json(&IndexLayout::PIXELSPLAT).as_bytes()),
            told: format!("{}, fewer context views", index.told),
            index: asked,
            name: index.name.clone(),
        }
    };
    let views = knobs.views.map(|views| format!("-{views}-views"));
    let resolution = knobs.resolution.map(|[height, width]| format!("-{height}x{width}"));
    let name = [Some(name.clone()), views, resolution].into_iter().flatten().collect();
    Ok(Dataset { name, preset: knobs.preset(preset)?, source: Arc::clone(source), told: told.clone(), index })
}
