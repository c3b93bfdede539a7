//! Numbers of tokens and Gaussians of a configuration and the memory they take, by formula: the paper's "Total Gaussian
//! Budgets".

use serde::Serialize;

use crate::ModelError;
use crate::config::{AnchorDesign, BackboneConfig, BlockExpansion, DinoArchitecture, ImageSize, ModelConfig};
use crate::parameters::{Parameter, parameters};

/// Numbers of tokens and Gaussians through the decoder.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct Budget {
    /// `N_init`: tokens that enter the first block.
    pub initial_tokens: usize,
    /// Tokens that each block expands.
    pub expanded: Vec<usize>,
    /// Tokens that leave each block.
    pub tokens: Vec<usize>,
    /// `N_final`.
    pub final_tokens: usize,
    /// `G = K · N_final`.
    pub gaussians: usize,
}

/// Smallest and largest budget of a configuration; equal if all blocks expand a fixed ratio.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct BudgetRange {
    /// If no token exceeds any threshold.
    pub min: Budget,
    /// If all do.
    pub max: Budget,
}

impl BudgetRange {
    /// The budget, if it does not depend on the scene.
    pub fn fixed(&self) -> Option<&Budget> {
        (self.min == self.max).then_some(&self.min)
    }
}

impl Budget {
    /// The budget of a configuration whose blocks expand the given numbers of tokens.
    ///
    /// # Errors
    /// [`ModelError::Malformed`] if the number of selections is not the number of blocks, or a block expands more tokens
    /// than it has.
    pub fn from_selections(
        config: &ModelConfig,
        initial_tokens: usize,
        expanded: &[usize],
    ) -> Result<Self, ModelError> {
        if expanded.len() != config.decoder.blocks.len() {
            let expected = format!("{} selections, one for each block", config.decoder.blocks.len());
            return Err(ModelError::malformed("budget", "selections", expected, expanded.len()));
        }
        let mut count = initial_tokens;
        let mut tokens = Vec::with_capacity(expanded.len());
        for (block, &chosen) in expanded.iter().enumerate() {
            let left = count.checked_sub(chosen).ok_or_else(|| {
                ModelError::malformed("budget", format!("block {block}"), format!("at most {count} tokens"), chosen)
            })?;
            count = left.saturating_add(chosen.saturating_mul(config.expansion.children));
            tokens.push(count);
        }
        let gaussians = count.saturating_mul(config.head.gaussians_per_token);
        Ok(Self { initial_tokens, expanded: expanded.to_vec(), tokens, final_tokens: count, gaussians })
    }

    /// `K`.
    ///
    /// # Panics
    /// For a budget without tokens, which no configuration has.
    #[expect(clippy::expect_used, reason = "an image has at least one patch, and expansion removes no token")]
    pub fn gaussians_per_token(&self) -> usize {
        self.gaussians.checked_div(self.final_tokens).expect("a network has tokens")
    }
}

/// Number of tokens that enter the decoder.
///
/// # Errors
/// [`ModelError::Indivisible`] if patches do not divide the image.
pub fn initial_tokens(config: &ModelConfig, views: usize, image: ImageSize) -> Result<usize, ModelError> {
    let patches = config.coarse_grid(image)?.len().saturating_mul(views);
    Ok(match config.anchors.design {
        AnchorDesign::LearnableTokens { tokens } => tokens,
        AnchorDesign::PatchDepth {} | AnchorDesign::RayDepth {} | AnchorDesign::DirectXyz {} => patches,
    })
}

/// Numbers of tokens and Gaussians for `views` views of this size.
///
/// # Errors
/// [`ModelError::Indivisible`] if patches do not divide the image.
pub fn budget(config: &ModelConfig, views: usize, image: ImageSize) -> Result<BudgetRange, ModelError> {
    let initial = initial_tokens(config, views, image)?;
    config.fine_grid(image)?;
    let with = |thresholds_exceeded: bool| {
        let mut count = initial;
        let expanded: Vec<usize> = config
            .decoder
            .blocks
            .iter()
            .map(|block| {
                let chosen = match block.active_expansion() {
                    Some(BlockExpansion::Ratio(ratio)) => ratio.of(count, config.expansion.ratio_rounding),
                    Some(BlockExpansion::Threshold(_)) if thresholds_exceeded => count,
                    Some(BlockExpansion::Threshold(_)) | None => 0,
                };
                count = (count - chosen).saturating_add(chosen.saturating_mul(config.expansion.children));
                chosen
            })
            .collect();
        Budget::from_selections(config, initial, &expanded)
    };
    Ok(BudgetRange { min: with(false)?, max: with(true)? })
}

/// Estimated memory to reconstruct a scene in f32, without gradients.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct MemoryEstimate {
    /// Weights in bytes.
    pub weight_bytes: u64,
    /// Largest set of values alive at one time, in bytes.
    pub activation_bytes: u64,
}

impl MemoryEstimate {
    /// Weights and activations.
    pub const fn peak_bytes(self) -> u64 {
        self.weight_bytes.saturating_add(self.activation_bytes)
    }
}

/// Estimates the peak memory of inference from the values that each stage keeps alive. Attention is fused and stores no
/// token-by-token matrix; a layer of n tokens and d channels stores its input, the normalised input, and either queries,
/// keys, values and the result, or the hidden channels of its feed-forward module.
///
/// # Errors
/// As [`budget`].
pub fn memory(config: &ModelConfig, views: usize, image: ImageSize) -> Result<MemoryEstimate, ModelError> {
    const BYTES: u64 = size_of::<f32>() as u64;
    let product = |factors: &[usize]| factors.iter().fold(1u64, |all, &factor| all.saturating_mul(factor as u64));
    let dim = config.transformer.dim;
    let layer = 2 + config.transformer.mlp_ratio.max(4);
    let (coarse_grid, fine_grid) = (config.coarse_grid(image)?, config.fine_grid(image)?);
    let coarse = product(&[views, coarse_grid.len(), dim]);
    let fine = product(&[views, fine_grid.len(), dim]);
    let tokens = budget(config, views, image)?.max;
    let images = product(&[views, image.height, image.width, 3]);

    let backbone = match config.backbone {
        BackboneConfig::DinoV2 { size, registers } => {
            let dino = DinoArchitecture::new(size, registers);
            let sequence = coarse_grid.len() + 1 + dino.registers;
            product(&[views, sequence, dino.dim, 2 + DinoArchitecture::MLP_RATIO])
        }
        BackboneConfig::Patch { .. } => coarse.saturating_mul(layer as u64),
    };
    let encoder = coarse.saturating_mul(layer as u64);
    // The fine patches' Plücker rays are twice the size of the images.
    let fine_branch = (coarse + 2 * images).saturating_add(fine.saturating_mul(layer as u64));
    let widest = tokens.tokens.iter().copied().fold(tokens.initial_tokens, usize::max);
    // Keys and values of the fine features, the features themselves and their normalised copy.
    let decoder = fine.saturating_mul(4).saturating_add(product(&[widest, dim, layer]));
    let outputs = config.head.channels(config.anchors.design.centre_channels());
    let head = product(&[tokens.final_tokens, dim, 3]).saturating_add(product(&[tokens.gaussians, outputs, 2]));
    let most = [backbone, encoder, fine_branch, decoder, head].into_iter().fold(0, u64::max);

    let weights: u64 = parameters(config).iter().map(Parameter::elements).map(|count| count as u64).sum();
    let activation_bytes = most.saturating_add(images).saturating_mul(BYTES);
    Ok(MemoryEstimate { weight_bytes: weights.saturating_mul(BYTES), activation_bytes })
}

#[cfg(test)]
mod tests;
