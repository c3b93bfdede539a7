//! The network on burn's tensors, in the parts of the paper: coarse branch, anchors, fine branch, decoder with expansion,
//! Gaussian head. `oracle/reference.py` implements the same in PyTorch, and tests compare the two stage by stage.
//!
//! [`Network::reconstruct`] returns plain numbers for one scene, with the time of each stage. [`Network::forward`] returns tensors, for
//! training.

mod anchors;
mod bicubic;
mod coarse;
mod dinov2;
mod encoder;
mod expansion;
mod fine;
mod flat;
mod flat_layout;
mod gaussians;
mod layers;
mod names;
mod patch_frame;
mod patches;
mod processor;
mod reconstruction;
mod render;
mod resize;
mod splatting;
mod tokens;
mod trace;
mod views;
#[cfg(feature = "gpu-network")]
mod wgpu_device;

use std::sync::{Arc, OnceLock};
use std::time::Instant;

use atsplat_files::Sha256Digest;
use atsplat_splat::gpu::AdapterDescription;
use burn::Tensor;
use burn::module::Module;
pub use burn::tensor::Device;
use burn::tensor::FloatDType;
use serde::Serialize;

pub use coarse::CoarseStages;
pub use expansion::Expanded;
pub use flat_layout::FlatLayout;
pub use gaussians::GaussianTensors;
pub use patch_frame::PatchFrames;
pub use processor::Processor;
pub use reconstruction::{BlockOutcome, EncodedScene, Reconstruction};
pub use render::{BackwardPass, RenderedTensors};
pub use tokens::{Place, Tokens};
pub use trace::Trace;
pub use views::Views;

pub use atsplat_nn::{MatmulPrecision, f32_values};

use crate::ModelError;
use crate::config::{ImageSize, ModelConfig};
use anchors::Anchors;
use coarse::{Backbone, Coarse};
use fine::{Fine, upsampled};
use layers::{Decoder, Head, LayerBuilder};
use patches::BranchInput;

/// ATSplat or one of its variants.
#[derive(Module, Debug)]
pub struct Network {
    backbone: Backbone,
    coarse: Coarse,
    anchors: Anchors,
    fine: Fine,
    decoder: Decoder,
    head: Head,
    #[module(skip)]
    config: ModelConfig,
    /// Size of the images that its weights were trained on.
    #[module(skip)]
    trained_at: Option<ImageSize>,
    /// The hash of the weights before the decoder, once it was asked for.
    #[module(skip)]
    encoder_sha256: Arc<OnceLock<Sha256Digest>>,
}

/// Output of the network for a batch of scenes, as tensors with gradients.
#[derive(Clone, Debug)]
pub struct Forward {
    /// The Gaussians.
    pub gaussians: GaussianTensors,
    /// The stages of the coarse branch.
    pub coarse: CoarseStages,
    /// Fine features, to which the decoder attends, `[scenes, views · patches, channels]`.
    pub fine: Tensor<3>,
    /// Tokens that entered the decoder.
    pub initial: Tokens,
    /// Output of each block.
    pub blocks: Vec<BlockTrace>,
}

/// Everything before the decoder, for a batch of scenes.
#[derive(Clone, Debug)]
struct Encoding {
    coarse: CoarseStages,
    fine: Tensor<3>,
    initial: Tokens,
}

/// Output of one block of the decoder.
#[derive(Clone, Debug)]
pub struct BlockTrace {
    /// Its expansion, if it expands.
    pub expanded: Option<Expanded>,
    /// Tokens that left the block, from which the Gaussian head predicts intermediate Gaussians.
    pub tokens: Tokens,
}

/// Wall-clock seconds of each stage.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct StageSeconds {
    /// Backbone and coarse branch.
    pub coarse: f64,
    /// Depths, unprojection, neighbours.
    pub anchors: f64,
    /// Fine branch.
    pub fine: f64,
    /// Decoder with expansion.
    pub decoder: f64,
    /// Gaussian head.
    pub head: f64,
}

impl StageSeconds {
    /// Sum over all stages.
    pub fn total(&self) -> f64 {
        self.stages().iter().map(|(_, seconds)| seconds).sum()
    }

    /// Each stage by name, in order.
    pub const fn stages(&self) -> [(&'static str, f64); 5] {
        let Self { coarse, anchors, fine, decoder, head } = *self;
        [("coarse", coarse), ("anchors", anchors), ("fine", fine), ("decoder", decoder), ("head", head)]
    }
}

impl Network {
    /// A network with newly initialised parameters; those of a frozen backbone are zeros until weights are loaded.
    ///
    /// # Errors
    /// [`ModelError::Malformed`] if the configuration contradicts itself.
    pub fn new(config: &ModelConfig, device: &Device) -> Result<Self, ModelError> {
        config.validate()?;
        let builder = LayerBuilder { transformer: &config.transformer, device };
        let channels = config.head.channels(config.anchors.design.centre_channels());
        Ok(Self {
            backbone: Backbone::new(config, builder),
            coarse: Coarse::new(config, builder),
            anchors: Anchors::new(config, builder),
            fine: Fine::new(config, builder),
            decoder: Decoder::new(config, builder),
            head: builder.head(config.head.gaussians_per_token * channels),
            config: config.clone(),
            trained_at: None,
            encoder_sha256: Arc::default(),
        })
    }

    /// Declares that the weights were trained on images of this size: [`Self::reconstruct`] and [`Self::trace`] then resize
    /// context images to its scale first ([`Self::input_size`]), because patches that show more or less of a scene than in
    /// training are out of distribution. [`Self::forward`] takes images as they are.
    #[must_use]
    pub fn trained_at(self, size: ImageSize) -> Self {
        Self { trained_at: Some(size), ..self }
    }

    /// The same network without resizing of context images.
    #[must_use]
    pub fn without_resizing(self) -> Self {
        Self { trained_at: None, ..self }
    }

    /// The size to which context images of `given` size are resized ([`ModelConfig::context_size`]); the given size if the
    /// training size is unknown.
    pub fn input_size(&self, given: ImageSize) -> ImageSize {
        self.trained_at.map_or(given, |trained| self.config.context_size(given, trained))
    }

    /// Size of the images that the weights were trained on, if known.
    pub const fn trained_size(&self) -> Option<ImageSize> {
        self.trained_at
    }

    /// The configuration.
    pub const fn config(&self) -> &ModelConfig {
        &self.config
    }

    /// The device of the parameters, which also says whether gradients are recorded.
    pub fn device(&self) -> Device {
        self.head.device()
    }

    /// Whether its device computes matrix products in this precision.
    pub fn supports_precision(&self, precision: MatmulPrecision) -> bool {
        match (precision, self.adapter()) {
            (MatmulPrecision::F32, _) | (MatmulPrecision::Bf16, None) => true,
            (MatmulPrecision::F16, Some(_)) => self.device().supports_dtype(FloatDType::F16),
            (MatmulPrecision::Bf16, Some(_)) | (MatmulPrecision::F16, None) => false,
        }
    }

    /// The graphics adapter that runs it; `None` for the CPU.
    pub fn adapter(&self) -> Option<AdapterDescription> {
        #[cfg(feature = "gpu-network")]
        return wgpu_device::adapter_of(&self.device());
        #[cfg(not(feature = "gpu-network"))]
        None
    }

    /// Runs a batch of scenes with the same number of views of the same size. A scene's result does not depend on the
    /// others, bit for bit.
    ///
    /// `call_seed` seeds random selection, in which scene i of a batch has the seed `call_seed + i`; every other selection
    /// ignores it.
    ///
    /// # Errors
    /// [`ModelError::Malformed`] if there is no scene, scenes differ in size or views, thresholds select different numbers of
    /// tokens in one batch, or scores or anchors are NaN; [`ModelError::Indivisible`] if patches do not divide the images;
    /// [`ModelError::NonFinite`] for rays beyond the range of f32.
    pub fn forward(&self, scenes: &[Views], call_seed: u64) -> Result<Forward, ModelError> {
        self.decode(self.encode(scenes, None)?, call_seed, None)
    }

    /// The part of [`Self::forward`] before the decoder, which does not depend on token expansion. Its stages are timed if there are
    /// `seconds` to add to.
    ///
    /// # Errors
    /// As [`Self::forward`], except for those of expansion.
    fn encode(&self, scenes: &[Views], seconds: Option<&mut StageSeconds>) -> Result<Encoding, ModelError> {
        let (config, device) = (&self.config, &self.device());
        let first =
            scenes.first().ok_or_else(|| ModelError::malformed("model input", "scenes", "at least one", "none"))?;
        let (views, size) = (first.len(), first.size());
        if let Some(other) = scenes.iter().find(|other| (other.len(), other.size()) != (views, size)) {
            let expected = format!("{views} views of {size} in each");
            let found = format!("{} views of {}", other.len(), other.size());
            return Err(ModelError::malformed("model input", "scenes", expected, found));
        }
        let (grid, fine_grid) = (config.coarse_grid(size)?, config.fine_grid(size)?);
        let mut clock = StageClock { device, seconds };
        let smaller = |factor: usize| scenes.iter().map(|views| views.smaller(factor)).collect::<Vec<Views>>();

        let coarse_scenes = smaller(config.coarse.image_downscale);
        let (coarse_inputs, coarse) = clock.time(
            |seconds| &mut seconds.coarse,
            || {
                let inputs = BranchInput::of_scenes(&coarse_scenes)?;
                let coarse = self.coarse.forward(&self.backbone, &inputs, config.coarse.patch_size, grid, device)?;
                Ok::<_, ModelError>((inputs, coarse))
            },
        )?;
        let initial = clock.time(
            |seconds| &mut seconds.anchors,
            || self.anchors.forward(config, &coarse_scenes, coarse.features.clone(), grid, device),
        )?;
        let fine = clock.time(
            |seconds| &mut seconds.fine,
            || {
                let patch = config.fine.patch_size;
                let features = if config.fine.image_downscale == config.coarse.image_downscale {
                    self.fine.forward(&coarse_inputs, patch, device)
                } else {
                    let scenes = smaller(config.fine.image_downscale);
                    self.fine.forward(&BranchInput::of_scenes(&scenes)?, patch, device)
                };
                let dim = config.transformer.dim;
                let per_view = coarse.features.clone().reshape([scenes.len() * views, grid.len(), dim]);
                let context = upsampled(&per_view, grid, fine_grid, config.fine.upsampling, device);
                Ok::<_, ModelError>((features + context).reshape([scenes.len(), views * fine_grid.len(), dim]))
            },
        )?;
        Ok(Encoding { coarse, fine, initial })
    }

    /// The part of [`Self::forward`] after [`Self::encode`].
    fn decode(
        &self,
        encoding: Encoding,
        call_seed: u64,
        seconds: Option<&mut StageSeconds>,
    ) -> Result<Forward, ModelError> {
        let device = &self.device();
        let mut clock = StageClock { device, seconds };
        let Encoding { coarse, fine, initial } = encoding;
        let blocks =
            clock.time(|seconds| &mut seconds.decoder, || self.blocks(initial.clone(), &fine, call_seed, device))?;
        let last = blocks.last().map_or(&initial, |block| &block.tokens);
        let gaussians = clock.time(|seconds| &mut seconds.head, || self.gaussians(last));
        Ok(Forward { gaussians, coarse, fine, initial, blocks })
    }

    /// The backbone's features of each view, `[views, patches, channels]` flattened. Those of a frozen backbone never change,
    /// so that a training run may cache them for [`Views::with_frozen_features`].
    ///
    /// # Errors
    /// As [`Self::forward`].
    pub fn frozen_features(&self, views: &Views) -> Result<Vec<f32>, ModelError> {
        let (settings, device) = (&self.config.coarse, &self.device());
        let grid = self.config.coarse_grid(views.size())?;
        let downscaled = views.smaller(settings.image_downscale);
        let input = BranchInput::new(&downscaled)?;
        Ok(f32_values(self.backbone.forward(&input, settings.patch_size, grid, device)?))
    }

    /// The Gaussians of tokens: the final ones for the last block, intermediate ones for any other.
    pub fn gaussians(&self, tokens: &Tokens) -> GaussianTensors {
        gaussians::gaussians(&self.config, &self.head, tokens)
    }

    fn blocks(
        &self,
        initial: Tokens,
        context: &Tensor<3>,
        call_seed: u64,
        device: &Device,
    ) -> Result<Vec<BlockTrace>, ModelError> {
        let mut tokens = initial;
        let mut trace = Vec::with_capacity(self.decoder.blocks.len());
        for position in 0..self.decoder.blocks.len() {
            let expanded;
            (tokens, expanded) = self.expanded(position, tokens, call_seed, device)?;
            tokens.features = self.attended(position, tokens.features, context);
            trace.push(BlockTrace { expanded, tokens: tokens.clone() });
        }
        Ok(trace)
    }

    /// The tokens that enter a block after its expansion, if it has one.
    fn expanded(
        &self,
        block: usize,
        tokens: Tokens,
        call_seed: u64,
        device: &Device,
    ) -> Result<(Tokens, Option<Expanded>), ModelError> {
        let how_many = self.config.decoder.blocks[block].active_expansion();
        let (Some(expansion), Some(how_many)) = (&self.decoder.blocks[block].expansion, how_many) else {
            return Ok((tokens, None));
        };
        let outcome = expansion.forward(&self.config.expansion, how_many, tokens, block, call_seed, device)?;
        Ok((outcome.0, Some(outcome.1)))
    }

    /// Features of tokens after a block's layers.
    fn attended(&self, block: usize, features: Tensor<3>, context: &Tensor<3>) -> Tensor<3> {
        let layers = &self.decoder.blocks[block].layers;
        layers.iter().fold(features, |features, layer| layer.forward(features, context.clone()))
    }
}

/// Takes the time of stages, if it has somewhere to add it. A training step has not: it would wait for its device after each stage.
struct StageClock<'a> {
    device: &'a Device,
    seconds: Option<&'a mut StageSeconds>,
}

impl StageClock<'_> {
    /// Does the work of a stage, and adds its seconds and those of the device's queue.
    fn time<T>(&mut self, stage: fn(&mut StageSeconds) -> &mut f64, work: impl FnOnce() -> T) -> T {
        let Some(seconds) = self.seconds.as_deref_mut() else { return work() };
        let start = Instant::now();
        let result = work();
        // A failure of the device is reported again when the result is read.
        self.device.sync().ok();
        *stage(seconds) += start.elapsed().as_secs_f64();
        result
    }
}

#[cfg(test)]
mod dinov2_tests;
#[cfg(test)]
mod expansion_tests;
#[cfg(test)]
mod gradient_tests;
#[cfg(test)]
mod hard_inputs_tests;
#[cfg(test)]
mod tests;
