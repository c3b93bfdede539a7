use atsplat_splat::Gaussians;

use super::reconstruction::Encoded;
use super::{EncodedScene, Forward, Network, Reconstruction, Views};
use crate::ModelError;

/// A reconstruction with its intermediate Gaussians, which training supervises (paper, "Learning uncertainty in 2D space").
#[derive(Clone, Debug)]
pub struct Trace {
    /// The reconstruction.
    pub reconstruction: Reconstruction,
    /// For each block, the Gaussians of the tokens that entered it, ordered by token.
    pub entering: Vec<Gaussians>,
}

impl Trace {
    /// The Gaussians of the tokens that left a block, counted from 0: those that entered the next block, or the final ones.
    pub fn leaving(&self, block: usize) -> &Gaussians {
        self.entering.get(block + 1).unwrap_or(&self.reconstruction.gaussians)
    }
}

impl Network {
    /// [`Network::reconstruct`] with intermediate Gaussians.
    ///
    /// # Errors
    /// As [`Network::reconstruct`]; intermediate Gaussians must be finite too.
    pub fn trace(&self, views: &Views, call_seed: u64) -> Result<Trace, ModelError> {
        self.traced(self.encoded(views)?, call_seed)
    }

    /// [`Self::trace`] of an encoded scene.
    ///
    /// # Errors
    /// As [`Self::trace`]; [`ModelError::Malformed`] for a scene that a network with another encoder has encoded.
    pub fn trace_encoded(&self, scene: EncodedScene, call_seed: u64) -> Result<Trace, ModelError> {
        self.traced(self.own(scene)?, call_seed)
    }

    fn traced(&self, encoded: Encoded, call_seed: u64) -> Result<Trace, ModelError> {
        let Encoded { encoding, mut input } = encoded;
        let forward = self.decode(encoding, call_seed, Some(&mut input.seconds))?;
        let Forward { initial, blocks, .. } = &forward;
        let last = blocks.len().saturating_sub(1);
        let entered = std::iter::once(initial).chain(blocks.iter().take(last).map(|block| &block.tokens));
        let entering = entered.take(blocks.len()).map(|tokens| self.gaussians(tokens).finite_scene(0));
        let entering = entering.collect::<Result<_, _>>()?;
        Ok(Trace { reconstruction: self.reconstruction(&forward, &input)?, entering })
    }

    /// The same weights with expansion only in the first `blocks` of the expanding blocks
    /// ([`ModelConfig::with_expansion_in_first`](crate::ModelConfig::with_expansion_in_first)).
    #[must_use]
    pub fn with_expansion_in_first(&self, blocks: usize) -> Self {
        Self { config: self.config.with_expansion_in_first(blocks), ..self.clone() }
    }
}
