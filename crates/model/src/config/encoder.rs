use serde::{Deserialize, Serialize};

/// The coarse branch: backbone features and raw patches, concatenated and mixed by a linear layer, Plücker
/// embedding added, then self-attention over the tokens of all views (paper, "Multi-view image encoder").
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub struct CoarseConfig {
    /// Side of a coarse patch in pixels of this branch's image; 16 in the paper.
    pub patch_size: usize,
    /// Factor by which this branch's image is downscaled; 2 at high resolution (paper, "High-Resolution Novel-View Synthesis").
    pub image_downscale: usize,
    /// Global self-attention layers; 12 in the paper.
    pub layers: usize,
}

/// The fine branch: patches with Plücker embedding, per-view self-attention, and the coarse features upsampled to the fine
/// grid and added (paper, "Image-to-3D decoder", and supplement, "Architecture Details").
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub struct FineConfig {
    /// Side of a fine patch in pixels of this branch's image; 8 in the paper.
    pub patch_size: usize,
    /// Factor by which this branch's image is downscaled; 1 in every setting here.
    pub image_downscale: usize,
    /// Per-view self-attention layers; 2 in the paper.
    pub layers: usize,
    /// Upsampling of coarse features to the fine grid.
    pub upsampling: Upsampling,
}

/// Upsampling of coarse features to the fine grid, by an integer factor.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Upsampling {
    /// Between patch centres, clamped at the border (PyTorch's `bilinear`, `align_corners=False`).
    Bilinear,
    /// Every fine patch takes the feature of its coarse patch.
    Nearest,
}
