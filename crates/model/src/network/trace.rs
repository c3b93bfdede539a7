use atsplat_splat::Gaussians;

use super::{Forward, Network, Reconstruction, Views};
use crate::ModelError;

/// A reconstruction, and what would have come out had the decoder ended earlier: the intermediate Gaussians that training
/// supervises (paper, "Learning uncertainty in 2D space").
#[derive(Clone, Debug)]
pub struct Trace {
    /// The reconstruction.
    pub made: Reconstruction,
    /// Of each block, the Gaussians of the tokens that entered it, token by token.
    pub entering: Vec<Gaussians>,
}

impl Trace {
    /// The Gaussians of the tokens that left a block, counted from 0: those that entered the next one, or the final ones.
    pub fn leaving(&self, block: usize) -> &Gaussians {
        self.entering.get(block + 1).unwrap_or(&self.made.gaussians)
    }
}

impl Network {
    /// As [`Network::reconstruct`], with the Gaussians on the way.
    ///
    /// # Errors
    /// As [`Network::reconstruct`]; intermediate Gaussians have to be finite too.
    pub fn trace(&self, views: &Views, call_seed: u64) -> Result<Trace, ModelError> {
        let views = &*self.seen(views);
        let forward = self.forward(std::slice::from_ref(views), call_seed)?;
        let Forward { initial, blocks, .. } = &forward;
        let last = blocks.len().saturating_sub(1);
        let entered = std::iter::once(initial).chain(blocks.iter().take(last).map(|block| &block.tokens));
        let entering = entered.take(blocks.len()).map(|tokens| self.gaussians(tokens).finite_scene(0));
        let entering = entering.collect::<Result<_, _>>()?;
        Ok(Trace { made: self.told(forward, views)?, entering })
    }

    /// The same weights with expansion in the first so many of the blocks that expand
    /// ([`ModelConfig::with_expansion_in_first`](crate::ModelConfig::with_expansion_in_first)).
    #[must_use]
    pub fn with_expansion_in_first(&self, blocks: usize) -> Self {
        Self { config: self.config.with_expansion_in_first(blocks), ..self.clone() }
    }
}
