use std::borrow::Cow;

use atsplat_nn::f32_values;
use atsplat_splat::Gaussians;
use serde::Serialize;

use super::encoder::Encoder;
use super::{Encoding, Forward, Network, StageSeconds, Tokens, Views};
use crate::budget::{Budget, MemoryEstimate, memory};
use crate::config::BlockConfig;
use crate::{ImageSize, ModelError};

/// Reconstruction of one scene, as plain numbers.
#[derive(Clone, Debug)]
pub struct Reconstruction {
    /// The Gaussians, in the frame of the views' cameras, ordered by final token; every token has the configured number.
    pub gaussians: Gaussians,
    /// Anchors of the tokens that entered the decoder, in scene units; none in designs without anchors.
    pub anchors: Option<Vec<[f32; 3]>>,
    /// Depths of these anchors along the unit rays through their patches, in scene units; in the design `patch-depth`.
    pub depths: Option<Vec<f32>>,
    /// Expansion of each block of the decoder.
    pub blocks: Vec<BlockOutcome>,
    /// Size of the images given to the network, after resizing ([`Network::input_size`]).
    pub input_size: ImageSize,
    /// Numbers of tokens and Gaussians.
    pub budget: Budget,
    /// Wall-clock seconds of each stage.
    pub seconds: StageSeconds,
    /// Estimated memory of the reconstruction.
    pub memory: MemoryEstimate,
}

/// Expansion of one block of the decoder. Tokens are numbered in the order in which they entered or left the block.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct BlockOutcome {
    /// Predicted uncertainty of each token that entered; for blocks that expand by a score.
    pub scores: Option<Vec<f32>>,
    /// Tokens that were expanded, ascending.
    pub selected: Vec<usize>,
    /// For each token that left, its parent, or itself if it was not expanded.
    pub parents: Vec<usize>,
}

impl Reconstruction {
    /// For each final token, the initial token from which it descends and whose anchor it has.
    pub fn origins(&self) -> Vec<usize> {
        let initial = (0..self.budget.initial_tokens).collect();
        self.blocks
            .iter()
            .fold(initial, |origins: Vec<usize>, block| block.parents.iter().map(|&parent| origins[parent]).collect())
    }
}

/// Everything before token expansion of one scene: the same for networks with the same weights that differ in expansion alone
/// ([`ModelConfig::encodes_like`](crate::ModelConfig::encodes_like)), and of use for no others.
#[derive(Clone, Debug)]
pub struct EncodedScene {
    encoded: Encoded,
    encoder: Encoder,
}

/// The encoding of one scene, and what a reconstruction says about it.
#[derive(Clone, Debug)]
pub(super) struct Encoded {
    pub(super) encoding: Encoding,
    pub(super) input: EncodedInput,
}

/// What was encoded, and in which time.
#[derive(Clone, Copy, Debug)]
pub(super) struct EncodedInput {
    views: usize,
    size: ImageSize,
    pub(super) seconds: StageSeconds,
}

impl Network {
    /// Reconstructs one scene. Images are resized to the scale of the training images, if that is known
    /// ([`Network::input_size`]). `call_seed` seeds random selection.
    ///
    /// # Errors
    /// As [`Network::forward`]; [`ModelError::NonFinite`] if a Gaussian is NaN or infinite, which only extreme weights or
    /// poses cause.
    pub fn reconstruct(&self, views: &Views, call_seed: u64) -> Result<Reconstruction, ModelError> {
        self.reconstructed(self.encoded(views)?, call_seed)
    }

    /// The part of [`Self::reconstruct`] that does not depend on token expansion.
    ///
    /// # Errors
    /// As [`Network::forward`].
    pub fn encode_scene(&self, views: &Views) -> Result<EncodedScene, ModelError> {
        Ok(EncodedScene { encoded: self.encoded(views)?, encoder: self.encoder() })
    }

    /// [`Self::reconstruct`] of an encoded scene; its seconds of the first stages are those of [`Self::encode_scene`].
    ///
    /// # Errors
    /// As [`Self::reconstruct`]; [`ModelError::Malformed`] for a scene that a network with another encoder has encoded.
    pub fn reconstruct_encoded(&self, scene: EncodedScene, call_seed: u64) -> Result<Reconstruction, ModelError> {
        self.reconstructed(self.own(scene)?, call_seed)
    }

    fn reconstructed(&self, encoded: Encoded, call_seed: u64) -> Result<Reconstruction, ModelError> {
        let Encoded { encoding, mut input } = encoded;
        let forward = self.decode(encoding, call_seed, Some(&mut input.seconds))?;
        self.reconstruction(&forward, &input)
    }

    /// The encoding of one scene, whose images are resized first.
    pub(super) fn encoded(&self, views: &Views) -> Result<Encoded, ModelError> {
        let views = &*self.resized_input(views);
        let mut seconds = StageSeconds::default();
        let encoding = self.encode(std::slice::from_ref(views), Some(&mut seconds))?;
        Ok(Encoded { encoding, input: EncodedInput { views: views.len(), size: views.size(), seconds } })
    }

    /// The encoding of a scene, unless another encoder made it.
    pub(super) fn own(&self, scene: EncodedScene) -> Result<Encoded, ModelError> {
        self.check_encoder(&scene.encoder)?;
        Ok(scene.encoded)
    }

    /// Predicted uncertainty of the tokens that enter each block that expands by score, as in [`BlockOutcome::scores`]. Nothing
    /// after the last of them is computed.
    ///
    /// # Errors
    /// As [`Network::forward`].
    pub fn scores(&self, views: &Views, call_seed: u64) -> Result<Vec<Vec<f32>>, ModelError> {
        let device = &self.device();
        let Encoding { fine, initial: mut tokens, .. } = self.encoded(views)?.encoding;
        let expanding = |block: &BlockConfig| block.active_expansion().is_some();
        let Some(last) = self.config().decoder.blocks.iter().rposition(expanding) else { return Ok(Vec::new()) };
        let mut scores = Vec::new();
        for block in 0..=last {
            let expanded;
            (tokens, expanded) = self.expanded(block, tokens, call_seed, device)?;
            scores.extend(expanded.and_then(|expanded| expanded.scores).map(f32_values));
            if block < last {
                tokens.features = self.attended(block, tokens.features, &fine);
            }
        }
        Ok(scores)
    }

    /// Views resized to the scale of the training images.
    pub(super) fn resized_input<'a>(&self, views: &'a Views) -> Cow<'a, Views> {
        let size = self.input_size(views.size());
        if size == views.size() { Cow::Borrowed(views) } else { Cow::Owned(views.resized(size)) }
    }

    /// The output of a forward pass of one scene as plain numbers.
    pub(super) fn reconstruction(&self, forward: &Forward, input: &EncodedInput) -> Result<Reconstruction, ModelError> {
        let EncodedInput { views, size: input_size, seconds } = *input;
        let config = self.config();
        let gaussians = forward.gaussians.finite_scene(0)?;
        let Tokens { features, place } = &forward.initial;
        let [_, initial_tokens, _] = features.dims();
        let blocks = outcomes(forward);
        let expanded: Vec<usize> = blocks.iter().map(|block| block.selected.len()).collect();
        Ok(Reconstruction {
            gaussians,
            anchors: place.anchors().cloned().map(|anchors| f32_values(anchors).as_chunks().0.to_vec()),
            depths: place.depths().cloned().map(f32_values),
            blocks,
            input_size,
            budget: Budget::from_selections(config, initial_tokens, &expanded)?,
            seconds,
            memory: memory(config, views, input_size)?,
        })
    }
}

/// The blocks' expansions of the first scene of a batch.
fn outcomes(forward: &Forward) -> Vec<BlockOutcome> {
    let [_, mut count, _] = forward.initial.features.dims();
    let outcome = |block: &super::BlockTrace| {
        let outcome = match &block.expanded {
            Some(expanded) => BlockOutcome {
                scores: expanded.scores.clone().map(|scores| f32_values(scores.slice_dim(0, 0..1))),
                selected: expanded.selected[0].clone(),
                parents: expanded.parents[0].clone(),
            },
            None => BlockOutcome { scores: None, selected: Vec::new(), parents: (0..count).collect() },
        };
        count = outcome.parents.len();
        outcome
    };
    forward.blocks.iter().map(outcome).collect()
}
