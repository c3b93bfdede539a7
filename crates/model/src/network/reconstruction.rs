use std::borrow::Cow;

use atsplat_splat::Gaussians;
use burn::Tensor;
use serde::Serialize;

use super::{Forward, Network, StageSeconds, Views};
use crate::budget::{Budget, MemoryEstimate, memory};
use crate::selection;
use crate::{ImageSize, ModelError};

/// What the network made of one scene, as plain numbers.
#[derive(Clone, Debug)]
pub struct Reconstruction {
    /// The Gaussians, in the frame of the views' cameras: those of the first final token first, as many of each token as
    /// the configuration says.
    pub gaussians: Gaussians,
    /// Where the tokens that entered the decoder are, in scene units; none in designs without a place.
    pub anchors: Option<Vec<[f32; 3]>>,
    /// Depths of these anchors along the unit rays through their patches, in scene units; in the design `patch-depth`.
    pub depths: Option<Vec<f32>>,
    /// What each block of the decoder did.
    pub blocks: Vec<BlockOutcome>,
    /// Size at which the network saw the pictures ([`Network::sees`]).
    pub seen_at: ImageSize,
    /// Tokens and Gaussians.
    pub budget: Budget,
    /// Wall-clock seconds of each stage.
    pub seconds: StageSeconds,
    /// An estimate of the memory that it took.
    pub memory: MemoryEstimate,
}

/// What one block of the decoder did. Tokens are numbered as they entered the block and as they left it.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct BlockOutcome {
    /// Predicted uncertainty of each token that entered; of blocks that expand by a score.
    pub scores: Option<Vec<f32>>,
    /// Tokens that were expanded, ascending.
    pub selected: Vec<usize>,
    /// Of each token that left, the one that it is or came from.
    pub parents: Vec<usize>,
}

impl Reconstruction {
    /// Of each final token, the initial one that it descends from, whose anchor it has.
    pub fn origins(&self) -> Vec<usize> {
        let initial = (0..self.budget.initial_tokens).collect();
        self.blocks.iter().fold(initial, |origins: Vec<usize>, block| {
            block.parents.iter().filter_map(|&parent| origins.get(parent).copied()).collect()
        })
    }

    /// The final token that a Gaussian belongs to.
    pub const fn token_of(&self, gaussian: usize) -> usize {
        let per_token = self.budget.gaussians.checked_div(self.budget.final_tokens);
        match per_token {
            Some(per_token) if per_token > 0 => gaussian / per_token,
            _ => 0,
        }
    }
}

impl Network {
    /// Gaussians of one scene, with what was decided on the way. The network sees the pictures at the scale that its weights
    /// were trained at, where that is known ([`Network::sees`]). `call_seed` is what random selection draws with.
    ///
    /// # Errors
    /// As [`Network::forward`]; [`ModelError::NonFinite`] where a Gaussian is NaN or infinite, which only weights or
    /// poses beyond all measure bring about.
    pub fn reconstruct(&self, views: &Views, call_seed: u64) -> Result<Reconstruction, ModelError> {
        let views = &*self.seen(views);
        let forward = self.forward(std::slice::from_ref(views), call_seed)?;
        self.told(forward, views)
    }

    /// Views as the network sees them.
    pub(super) fn seen<'a>(&self, views: &'a Views) -> Cow<'a, Views> {
        let size = self.sees(views.size());
        if size == views.size() { Cow::Borrowed(views) } else { Cow::Owned(views.resized(size)) }
    }

    /// A forward pass of one scene in plain numbers.
    pub(super) fn told(&self, forward: Forward, views: &Views) -> Result<Reconstruction, ModelError> {
        let config = self.config();
        let gaussians = forward.gaussians.finite_scene(0)?;
        let [_, initial_tokens, _] = forward.initial.features.dims();
        let blocks = outcomes(&forward);
        let expanded: Vec<usize> = blocks.iter().map(|block| block.selected.len()).collect();
        Ok(Reconstruction {
            gaussians,
            anchors: forward.initial.anchors.map(|anchors| numbers(anchors).as_chunks().0.to_vec()),
            depths: forward.initial.depths.map(numbers),
            blocks,
            seen_at: views.size(),
            budget: Budget::of_selections(config, initial_tokens, &expanded)?,
            seconds: forward.seconds,
            memory: memory(config, views.len(), views.size())?,
        })
    }
}

/// Of the first scene of a batch.
fn outcomes(forward: &Forward) -> Vec<BlockOutcome> {
    let [_, mut count, _] = forward.initial.features.dims();
    let outcome = |block: &super::BlockTrace| {
        let expanded = block.expanded.as_ref();
        let first = |of: &[Vec<usize>]| of.first().cloned();
        let selected = expanded.and_then(|expanded| first(&expanded.selected)).unwrap_or_default();
        let parents = expanded.and_then(|expanded| first(&expanded.parents));
        let parents = parents.unwrap_or_else(|| selection::parents(count, &[], 1));
        count = parents.len();
        let scores = expanded.and_then(|expanded| expanded.scores.clone());
        BlockOutcome { scores: scores.map(|scores| numbers(scores.slice_dim(0, 0..1))), selected, parents }
    };
    forward.blocks.iter().map(outcome).collect()
}

fn numbers<const D: usize>(tensor: Tensor<D>) -> Vec<f32> {
    tensor.into_data_as::<f32>().as_slice::<f32>().unwrap_or_default().to_vec()
}
