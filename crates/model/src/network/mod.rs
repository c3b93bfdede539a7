//! The network on burn's tensors, part by part as the paper has it: coarse branch, anchors, fine branch, decoder with
//! expansion, Gaussian head. `oracle/twin.py` is its twin, and tests compare the two stage by stage.
//!
//! [`Network::reconstruct`] turns one scene's views into plain numbers. [`Network::forward`] keeps tensors, for training.

mod anchors;
mod bicubic;
mod coarse;
mod decoder;
mod dinov2;
mod expansion;
mod fine;
mod gaussians;
mod layers;
mod names;
mod patch_frame;
mod processor;
mod reconstruction;
mod render;
mod resize;
mod splatting;
mod trace;
mod views;

use std::time::Instant;

use burn::Tensor;
use burn::module::Module;
pub use burn::tensor::Device;
use serde::Serialize;

pub use anchors::Tokens;
pub use coarse::CoarseStages;
pub use expansion::Expanded;
pub use gaussians::GaussianTensors;
pub use patch_frame::PatchFrames;
pub use processor::Processor;
pub use reconstruction::{BlockOutcome, Reconstruction};
pub use render::RenderedTensors;
pub use trace::Trace;
pub use views::Views;

pub use atsplat_nn::f32_values;

use crate::ModelError;
use crate::config::{ImageSize, ModelConfig};
use anchors::Anchors;
use coarse::{Backbone, Coarse};
use decoder::Decoder;
use fine::{Fine, upsampled};
use layers::{Head, Maker};

/// ATSplat, or one of its variants.
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
    /// What size of pictures its weights were trained at.
    #[module(skip)]
    trained_at: Option<ImageSize>,
}

/// What the network made of a batch of scenes, as tensors through which gradients flow.
#[derive(Clone, Debug)]
pub struct Forward {
    /// The Gaussians.
    pub gaussians: GaussianTensors,
    /// The stages of the coarse branch.
    pub coarse: CoarseStages,
    /// Features that the decoder looks at, `[scenes, views · patches, channels]`.
    pub fine: Tensor<3>,
    /// Tokens that entered the decoder.
    pub initial: Tokens,
    /// What each block did, and the tokens that left it.
    pub blocks: Vec<BlockTrace>,
    /// Wall-clock seconds of each stage.
    pub seconds: StageSeconds,
}

/// One block of the decoder.
#[derive(Clone, Debug)]
pub struct BlockTrace {
    /// What was expanded, if anything.
    pub expanded: Option<Expanded>,
    /// Tokens that left the block: the Gaussian head makes the intermediate Gaussians of them.
    pub tokens: Tokens,
}

/// Wall-clock seconds.
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
    /// All stages.
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
    /// A network with fresh parameters; the backbone's are zeros until weights are put in.
    ///
    /// # Errors
    /// [`ModelError::Malformed`] where the configuration contradicts itself.
    pub fn new(config: &ModelConfig, device: &Device) -> Result<Self, ModelError> {
        config.validate()?;
        let make = Maker { transformer: &config.transformer, device };
        let channels = config.head.channels(config.anchors.design.centre_channels());
        Ok(Self {
            backbone: Backbone::new(config, make),
            coarse: Coarse::new(config, make),
            anchors: Anchors::new(config, make),
            fine: Fine::new(config, make),
            decoder: Decoder::new(config, make),
            head: make.head(config.head.gaussians_per_token * channels),
            config: config.clone(),
            trained_at: None,
        })
    }

    /// The same network with weights that were trained on pictures of this size: from now on [`Self::reconstruct`] and
    /// [`Self::trace`] bring context pictures to its scale first ([`Self::sees`]), because a patch that shows more or less of
    /// a scene than those it learnt from is strange to it. [`Self::forward`] takes pictures as they are.
    #[must_use]
    pub fn trained_at(self, size: ImageSize) -> Self {
        Self { trained_at: Some(size), ..self }
    }

    /// The same network seeing context pictures as they are.
    #[must_use]
    pub fn seeing_as_given(self) -> Self {
        Self { trained_at: None, ..self }
    }

    /// The size that context pictures of `given` size are brought to ([`ModelConfig::context_size`]); the given one where
    /// it is unknown what the weights were trained at.
    pub fn sees(&self, given: ImageSize) -> ImageSize {
        self.trained_at.map_or(given, |trained| self.config.context_size(given, trained))
    }

    /// What size of pictures its weights were trained at, where that is known.
    pub const fn trained_size(&self) -> Option<ImageSize> {
        self.trained_at
    }

    /// The configuration.
    pub const fn config(&self) -> &ModelConfig {
        &self.config
    }

    /// Where the parameters are, and with or without gradients.
    pub fn device(&self) -> Device {
        self.head.device()
    }

    /// Scenes of one size and as many views, in one batch. A scene's result does not depend on the others, to the bit.
    ///
    /// `call_seed` decides what random selection draws; every other selection ignores it.
    ///
    /// # Errors
    /// [`ModelError::Malformed`] where there is no scene, scenes differ in size or views, thresholds select different
    /// numbers of tokens in one batch, or the network gives NaN where it has to choose; [`ModelError::Indivisible`] where
    /// patches do not divide the pictures; [`ModelError::NonFinite`] for rays that f32 cannot hold.
    pub fn forward(&self, scenes: &[Views], call_seed: u64) -> Result<Forward, ModelError> {
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
        let mut seconds = StageSeconds::default();
        let smaller = |factor: usize| scenes.iter().map(|views| views.smaller(factor)).collect::<Vec<Views>>();

        let coarse_scenes = smaller(config.coarse.image_downscale);
        let coarse = timed(&mut seconds.coarse, device, || {
            self.coarse.forward(&self.backbone, &coarse_scenes, config.coarse.patch_size, grid, device)
        })?;
        let initial = timed(&mut seconds.anchors, device, || {
            self.anchors.forward(config, &coarse_scenes, coarse.features.clone(), grid, device)
        })?;
        let fine = timed(&mut seconds.fine, device, || {
            let own = self.fine.forward(&smaller(config.fine.image_downscale), config.fine.patch_size, device)?;
            let dim = config.transformer.dim;
            let per_view = coarse.features.clone().reshape([scenes.len() * views, grid.len(), dim]);
            let context = upsampled(per_view, grid, fine_grid, config.fine.upsampling, device);
            Ok::<_, ModelError>((own + context).reshape([scenes.len(), views * fine_grid.len(), dim]))
        })?;
        let blocks = timed(&mut seconds.decoder, device, || self.decode(initial.clone(), &fine, call_seed, device))?;
        let last = blocks.last().map_or(&initial, |block| &block.tokens);
        let gaussians = timed(&mut seconds.head, device, || self.gaussians(last));
        Ok(Forward { gaussians, coarse, fine, initial, blocks, seconds })
    }

    /// What the backbone makes of each view by itself, `[views, patches, channels]` in one row; for a frozen backbone the
    /// same whenever it is asked, so that a training run may keep it for [`Views::with_frozen_features`].
    ///
    /// # Errors
    /// As [`Self::forward`].
    pub fn frozen_features(&self, views: &Views) -> Result<Vec<f32>, ModelError> {
        let (settings, device) = (&self.config.coarse, &self.device());
        let grid = self.config.coarse_grid(views.size())?;
        let seen = views.smaller(settings.image_downscale);
        let features = self.backbone.forward(&seen, settings.patch_size, grid, device)?;
        Ok(features.into_data_as::<f32>().as_slice::<f32>().unwrap_or_default().to_vec())
    }

    /// The Gaussians of tokens: those of the last block, or the intermediate ones of any other.
    pub fn gaussians(&self, tokens: &Tokens) -> GaussianTensors {
        gaussians::gaussians(&self.config, &self.head, tokens)
    }

    fn decode(
        &self,
        initial: Tokens,
        context: &Tensor<3>,
        call_seed: u64,
        device: &Device,
    ) -> Result<Vec<BlockTrace>, ModelError> {
        let mut tokens = initial;
        let mut trace = Vec::with_capacity(self.decoder.blocks.len());
        for (position, (block, settings)) in self.decoder.blocks.iter().zip(&self.config.decoder.blocks).enumerate() {
            let mut expanded = None;
            if let (Some(expansion), Some(how_many)) = (&block.expansion, settings.active_expansion()) {
                let outcome =
                    expansion.forward(&self.config.expansion, how_many, tokens, position, call_seed, device)?;
                (tokens, expanded) = (outcome.0, Some(outcome.1));
            }
            for layer in &block.layers {
                tokens.features = layer.forward(tokens.features, context.clone());
            }
            trace.push(BlockTrace { expanded, tokens: tokens.clone() });
        }
        Ok(trace)
    }
}

/// The device's work is finished before the clock is read.
fn timed<T>(seconds: &mut f64, device: &Device, work: impl FnOnce() -> T) -> T {
    let start = Instant::now();
    let result = work();
    // A device that fails says so again to whoever reads the result.
    device.sync().ok();
    *seconds += start.elapsed().as_secs_f64();
    result
}

#[cfg(test)]
mod dinov2_tests;
#[cfg(test)]
mod expansion_tests;
#[cfg(test)]
mod gradient_tests;
#[cfg(test)]
mod hard_inputs;
#[cfg(test)]
mod tests;
