use std::fmt::Display;

use super::{
    AnchorContext, AnchorDesign, BackboneConfig, BlockExpansion, DepthActivation, HeadFrame, ModelConfig,
    OffsetActivation, QueryKeyNorm, ScaleActivation,
};
use crate::ModelError;

pub(super) const WHAT: &str = "model configuration";

/// More layers, channels or tokens than this are a typing error.
const MAX_LAYERS: usize = 256;
const MAX_CHANNELS: usize = 16_384;
const MAX_TOKENS: usize = 1 << 20;
const MAX_GAUSSIANS: usize = 4096;
/// That of decoded images.
const MAX_SIDE: usize = 16_384;
const MAX_SH_DEGREE: u8 = 4;

/// Checks the parts of a configuration by themselves and together.
pub(super) fn check(config: &ModelConfig) -> Result<(), ModelError> {
    let allowed = |c: char| c.is_ascii_lowercase() || c.is_ascii_digit() || c == '-';
    let named = !config.name.is_empty() && config.name.chars().all(allowed);
    ensure(named, "name", "lower-case letters, digits and hyphens", &format!("{:?}", config.name))?;
    counted("views", config.views, 1, 1 << 16)?;
    transformer(config)?;
    branches(config)?;
    anchors(config)?;
    decoder(config)?;
    head(config)
}

fn transformer(config: &ModelConfig) -> Result<(), ModelError> {
    let transformer = &config.transformer;
    counted("transformer.dim", transformer.dim, 1, MAX_CHANNELS)?;
    counted("transformer.head-dim", transformer.head_dim, 1, transformer.dim)?;
    let divides = transformer.dim.is_multiple_of(transformer.head_dim);
    ensure(divides, "transformer.head-dim", "a divisor of transformer.dim", &transformer.head_dim)?;
    counted("transformer.mlp-ratio", transformer.mlp_ratio, 1, 64)?;
    positive("transformer.norm-eps", transformer.norm_eps)?;
    match transformer.query_key_norm {
        QueryKeyNorm::Rms { eps } => positive("transformer.query-key-norm.eps", eps),
        QueryKeyNorm::None {} => Ok(()),
    }
}

fn branches(config: &ModelConfig) -> Result<(), ModelError> {
    let (coarse, fine) = (&config.coarse, &config.fine);
    for (branch, patch, downscale, layers) in [
        ("coarse", coarse.patch_size, coarse.image_downscale, coarse.layers),
        ("fine", fine.patch_size, fine.image_downscale, fine.layers),
    ] {
        counted(&format!("{branch}.patch-size"), patch, 1, 256)?;
        counted(&format!("{branch}.image-downscale"), downscale, 1, 16)?;
        counted(&format!("{branch}.layers"), layers, 0, MAX_LAYERS)?;
    }
    if let BackboneConfig::Patch { layers } = config.backbone {
        counted("backbone.layers", layers, 0, MAX_LAYERS)?;
    }
    let (coarse_step, fine_step) = (coarse.patch_size * coarse.image_downscale, fine.patch_size * fine.image_downscale);
    ensure(
        coarse_step.is_multiple_of(fine_step),
        "fine",
        &format!("patches that divide the coarse branch's, {coarse_step} pixels of the input"),
        &format!("{fine_step} pixels"),
    )?;
    for side in [config.resolution.height, config.resolution.width] {
        counted("resolution", side, 1, MAX_SIDE)?;
    }
    config.coarse_grid(config.resolution)?;
    config.fine_grid(config.resolution)?;
    Ok(())
}

fn anchors(config: &ModelConfig) -> Result<(), ModelError> {
    let anchors = &config.anchors;
    if let AnchorDesign::LearnableTokens { tokens } = anchors.design {
        counted("anchors.design.tokens", tokens, 1, MAX_TOKENS)?;
    }
    match anchors.depth {
        DepthActivation::LogSigmoid { near, far, shift } | DepthActivation::InverseSigmoid { near, far, shift } => {
            positive("anchors.depth.near", near)?;
            planes(near, far, shift)?;
        }
        DepthActivation::Sigmoid { near, far, shift } => {
            ensure(near >= 0.0, "anchors.depth.near", "a number from 0", &near)?;
            planes(near, far, shift)?;
        }
        DepthActivation::Exp { shift } => finite("anchors.depth.shift", shift)?,
    }
    match anchors.context {
        AnchorContext::PointNet { neighbours } => {
            counted("anchors.context.neighbours", neighbours, 1, 1024)?;
            let has_anchors = anchors.design.has_anchors();
            ensure(has_anchors, "anchors.context", "none, because tokens of this design have no position", &"point-net")
        }
        AnchorContext::None {} => Ok(()),
    }
}

fn planes(near: f64, far: f64, shift: f64) -> Result<(), ModelError> {
    let in_order = near < far && far.is_finite();
    ensure(in_order, "anchors.depth", "near < far", &format!("{near} and {far}"))?;
    finite("anchors.depth.shift", shift)
}

fn decoder(config: &ModelConfig) -> Result<(), ModelError> {
    let blocks = &config.decoder.blocks;
    counted("decoder.blocks", blocks.len(), 1, MAX_LAYERS)?;
    counted("expansion.children", config.expansion.children, 1, 64)?;
    let selection = config.expansion.selection;
    for (position, block) in blocks.iter().enumerate() {
        let field = format!("decoder.blocks[{position}]");
        counted(&format!("{field}.layers"), block.layers, 0, MAX_LAYERS)?;
        let Some(BlockExpansion::Threshold(threshold)) = block.expansion else { continue };
        finite(&format!("{field}.expansion.threshold"), threshold)?;
        let scored = selection.is_scored();
        ensure(scored, &format!("{field}.expansion"), "a ratio, because this selection has no scores", &"a threshold")?;
    }
    let expands = blocks.iter().any(|block| block.expansion.is_some());
    let placed = config.anchors.design.has_anchors() || !expands || !selection.needs_anchors();
    ensure(placed, "expansion.selection", "one that needs no anchors, because this design has none", &selection.name())
}

fn head(config: &ModelConfig) -> Result<(), ModelError> {
    let head = &config.head;
    counted("head.gaussians-per-token", head.gaussians_per_token, 1, MAX_GAUSSIANS)?;
    if let Some(cells) = head.patch_cells {
        counted("head.patch-cells", cells, head.gaussians_per_token, MAX_GAUSSIANS)?;
    }
    let degree = head.sh_degree <= MAX_SH_DEGREE;
    ensure(degree, "head.sh-degree", &format!("0 to {MAX_SH_DEGREE}"), &head.sh_degree)?;
    let placed = head.frame == HeadFrame::World || config.anchors.design.has_anchors();
    ensure(placed, "head.frame", "world, because tokens of this design have no patch depth", &"patch")?;
    match head.offset {
        OffsetActivation::Linear { gain } | OffsetActivation::InverseLog { gain } => {
            positive("head.offset.gain", gain)?;
        }
    }
    match head.scale {
        ScaleActivation::ExpClamped { shift, max } => {
            finite("head.scale.shift", shift)?;
            finite("head.scale.max", max)?;
        }
        ScaleActivation::Softplus { shift, gain } => {
            finite("head.scale.shift", shift)?;
            positive("head.scale.gain", gain)?;
        }
    }
    let super::OpacityActivation::Sigmoid { shift } = head.opacity;
    finite("head.opacity.shift", shift)
}

fn counted(field: &str, found: usize, least: usize, most: usize) -> Result<(), ModelError> {
    ensure((least..=most).contains(&found), field, &format!("{least} to {most}"), &found)
}

fn positive(field: &str, value: f64) -> Result<(), ModelError> {
    ensure(value > 0.0 && value.is_finite(), field, "a positive number", &value)
}

fn finite(field: &str, value: f64) -> Result<(), ModelError> {
    ensure(value.is_finite(), field, "a finite number", &value)
}

fn ensure(is_valid: bool, field: &str, expected: &str, found: &dyn Display) -> Result<(), ModelError> {
    if is_valid { Ok(()) } else { Err(ModelError::malformed(WHAT, format!("field {field}"), expected, found)) }
}
