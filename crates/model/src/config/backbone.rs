use serde::{Deserialize, Serialize};

/// The per-view network that computes coarse patch features.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields, tag = "kind")]
pub enum BackboneConfig {
    /// A frozen DINOv2: last-layer patch tokens after the final norm. The image is resized so that a coarse
    /// patch becomes one 14×14 patch (antialiased bilinear), and normalised with ImageNet's mean and deviation.
    DinoV2 {
        /// Size of the published network.
        size: DinoSize,
        /// Whether the variant with register tokens is used.
        registers: bool,
    },
    /// Without pretrained weights: a linear layer over each patch's colours and Plücker coordinates, and per-view
    /// self-attention layers. Used by the embedded checkpoint; not in the paper.
    #[serde(rename_all = "kebab-case")]
    Patch {
        /// Per-view self-attention layers, of the network's width.
        layers: usize,
    },
}

/// Supported sizes of DINOv2 (`facebookresearch/dinov2` `hub/backbones.py`).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum DinoSize {
    /// 32 channels, 2 layers, 2 heads, positions for 3×3 patches: for tests, not a published network.
    Tiny,
    /// ViT-S/14: 384 channels, 12 layers, 6 heads.
    Small,
    /// ViT-B/14: 768 channels, 12 layers, 12 heads; the paper's.
    Base,
    /// ViT-L/14: 1024 channels, 24 layers, 16 heads.
    Large,
}

/// Dimensions of a DINOv2 network (`facebookresearch/dinov2` `models/vision_transformer.py:96-169`).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct DinoArchitecture {
    /// Channels of every token.
    pub dim: usize,
    /// Transformer layers.
    pub layers: usize,
    /// Attention heads.
    pub heads: usize,
    /// Register tokens between the class token and the patches.
    pub registers: usize,
    /// Side of the square grid of the stored position embeddings.
    pub position_side: usize,
    /// Interpolation of position embeddings to another grid.
    pub interpolation: PositionInterpolation,
}

/// Interpolation of position embeddings to another grid, which differs between the published variants
/// (`facebookresearch/dinov2` `models/vision_transformer.py:180-212`, `hub/backbones.py:18-58`).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PositionInterpolation {
    /// Without registers: bicubic with a = −0.75 at source coordinates of scale `(grid + 0.1) / side`.
    OffsetBicubic,
    /// With registers: antialiased bicubic with a = −0.5 to the grid's exact size.
    AntialiasedBicubic,
}

impl DinoArchitecture {
    /// Side of a DINOv2 patch in pixels.
    pub const PATCH_SIZE: usize = 14;
    /// Hidden channels of a feed-forward module, in multiples of `dim`.
    pub const MLP_RATIO: usize = 4;
    /// Added to the variance in layer norms.
    pub const NORM_EPS: f64 = 1e-6;

    /// The dimensions of a published network.
    pub const fn new(size: DinoSize, registers: bool) -> Self {
        let (dim, layers, heads, position_side) = match size {
            DinoSize::Tiny => (32, 2, 2, 3),
            DinoSize::Small => (384, 12, 6, 37),
            DinoSize::Base => (768, 12, 12, 37),
            DinoSize::Large => (1024, 24, 16, 37),
        };
        let interpolation =
            if registers { PositionInterpolation::AntialiasedBicubic } else { PositionInterpolation::OffsetBicubic };
        Self { dim, layers, heads, registers: if registers { 4 } else { 0 }, position_side, interpolation }
    }
}

impl BackboneConfig {
    /// Whether its weights are pretrained and frozen.
    pub const fn is_frozen(&self) -> bool {
        matches!(self, Self::DinoV2 { .. })
    }

    /// Channels of the backbone's patch features, in a network of `dim` channels.
    pub const fn dim(&self, dim: usize) -> usize {
        match self {
            Self::DinoV2 { size, registers } => DinoArchitecture::new(*size, *registers).dim,
            Self::Patch { .. } => dim,
        }
    }
}
