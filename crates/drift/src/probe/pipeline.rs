use std::collections::BTreeMap;

use atsplat_metrics::learned::WeightsFolders;
use atsplat_metrics::{Networks, Score, Suite, definition};
use atsplat_model::network::{Device, Network, Views};
use atsplat_model::weights::{ModelWeights, StoredTensors, TensorFile, generated};
use atsplat_model::{ModelConfig, ModelError, parameters::parameters};
use atsplat_pixels::{DecodeLimits, Image, ImageU8, decode};
use atsplat_scene::preprocess::Preprocessing;
use atsplat_splat::cpu::CpuRenderer;
use atsplat_splat::{Gaussians, RenderOptions, RendererConstants};

use super::{ProbeWeights, Recipe, Stage, Stages, View};
use crate::DriftError;

/// The current implementation of the stages, on the CPU.
#[derive(Debug)]
pub struct Pipeline {
    /// Preprocessing of images and intrinsics.
    pub preprocessing: Preprocessing,
    /// Reconstructs Gaussians.
    pub network: Network,
    /// Rendering options.
    pub options: RenderOptions,
    /// The metrics.
    pub suite: Suite,
}

impl Pipeline {
    /// The stages of a recipe.
    ///
    /// # Errors
    /// [`DriftError::Invalid`] for an unknown name and for no metric, [`DriftError::Stage`] for weights that do not match the network.
    pub fn of(recipe: &Recipe) -> Result<Self, DriftError> {
        let config = ModelConfig::resolve(&recipe.model).map_err(|error| Stage::Model.failed()(&error))?;
        let tensors = weights(&config, &recipe.weights)?;
        Self::with_weights(recipe, &config, &tensors)
    }

    /// The stages of a recipe with these weights instead of the recipe's.
    ///
    /// # Errors
    /// Those of [`Self::of`].
    pub fn with_weights(recipe: &Recipe, config: &ModelConfig, tensors: &StoredTensors) -> Result<Self, DriftError> {
        let network = Network::new(config, &Device::flex()).and_then(|network| network.with_weights(tensors));
        let constants = RendererConstants::named(&recipe.constants)
            .ok_or_else(|| DriftError::invalid("constants", RendererConstants::listed_presets(), &recipe.constants))?;
        if recipe.metrics.is_empty() {
            return Err(DriftError::invalid("metrics", "at least one id of a metric", "none"));
        }
        let definitions: Result<Vec<_>, _> = recipe
            .metrics
            .iter()
            .map(|id| definition(id).ok_or_else(|| DriftError::invalid("metrics", "the id of a metric", id)))
            .collect();
        let definitions = definitions?;
        let networks = Networks::for_definitions(&definitions, &WeightsFolders::default());
        Ok(Self {
            preprocessing: recipe.preprocessing.clone(),
            network: network.map_err(|error| Stage::Model.failed()(&error))?,
            options: RenderOptions { constants, background: recipe.background, ..RenderOptions::default() },
            suite: Suite::new(definitions, networks.map_err(|error| Stage::Metric.failed()(&error))?, 0),
        })
    }
}

/// Loads or generates a recipe's weights.
pub(super) fn weights(config: &ModelConfig, weights: &ProbeWeights) -> Result<StoredTensors, DriftError> {
    match weights {
        ProbeWeights::Seed(seed) => Ok(generated(&parameters(config), *seed)),
        ProbeWeights::File(path) => TensorFile::open(path)
            .map_err(ModelError::from)
            .and_then(|file| ModelWeights::from_stored(&file.stored))
            .map(|weights| weights.tensors)
            .map_err(|error| Stage::Model.failed()(&error)),
    }
}

impl Stages for Pipeline {
    fn decode(&self, bytes: &[u8]) -> Result<ImageU8, DriftError> {
        decode(bytes, &DecodeLimits::default()).map_err(|error| Stage::Decode.failed()(&error))
    }

    fn resize(&self, view: &View) -> Result<View, DriftError> {
        let resized = || {
            let plan = self.preprocessing.plan(view.size())?;
            Ok(View { image: plan.apply(&view.image)?, camera: plan.camera(&view.camera)? })
        };
        resized().map_err(|error: atsplat_scene::preprocess::PreprocessError| Stage::Resize.failed()(&error))
    }

    fn model(&self, context: &[View]) -> Result<Gaussians, DriftError> {
        let reconstruct = || {
            let cameras = context.iter().map(|view| view.camera).collect();
            let views = Views::of_images(context.iter().map(|view| &view.image), cameras)?;
            self.network.reconstruct(&views, 0)
        };
        reconstruct().map(|reconstruction| reconstruction.gaussians).map_err(|error| Stage::Model.failed()(&error))
    }

    fn render(&self, gaussians: &Gaussians, target: &View) -> Result<Image, DriftError> {
        let view = atsplat_splat::View { camera: target.camera, size: target.size() };
        let rendering = CpuRenderer::default().render(gaussians, &view, &self.options);
        let rendering = rendering.map_err(|error| Stage::Renderer.failed()(&error))?;
        let samples = rendering.rgb.as_flattened().to_vec();
        Image::new(rendering.size.width, rendering.size.height, samples)
            .map_err(|error| Stage::Renderer.failed()(&error))
    }

    fn score(&self, render: &Image, truth: &ImageU8) -> Result<BTreeMap<String, f64>, DriftError> {
        let scored = self.suite.score(render, &Image::from_u8(truth));
        let value = |(id, score): (&str, Score)| match score {
            Score::Value(value) => Ok((id.to_owned(), value)),
            Score::Identical => Ok((id.to_owned(), atsplat_metrics::DECIBEL_CAP)),
            Score::NotComputed(reason) => Err(Stage::Metric.failed()(&format!("{id}: {reason}"))),
        };
        scored.scores.into_iter().map(value).collect()
    }
}
