use serde::{Deserialize, Serialize};

use super::DepthActivation;

/// Positions of tokens in space (paper, "Initializing sparse anchor tokens" and "3D anchor designs").
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub struct AnchorConfig {
    /// Design, a row of the paper's ablation.
    pub design: AnchorDesign,
    /// Activation of the depth head.
    pub depth: DepthActivation,
    /// How anchors see their neighbours.
    pub context: AnchorContext,
}

/// How tokens are initialised, and what the centres of their Gaussians are relative to.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields, tag = "kind")]
pub enum AnchorDesign {
    /// "Patch depth, anchor + offset", the paper's: a depth per coarse patch, unprojected along the unit ray
    /// through the patch's centre; centres are offsets from there.
    PatchDepth {},
    /// "None, ray + depth": tokens are coarse patches without a position. A patch is divided into as many cells as a token
    /// has Gaussians, and each Gaussian is on the ray through its cell's centre, at a depth that the Gaussian head
    /// predicts instead of an offset. Children share their parent's rays.
    RayDepth {},
    /// "Learnable, direct xyz": a learned set of tokens, the same for every scene; centres are given in the
    /// normalised frame.
    LearnableTokens {
        /// Number of tokens.
        tokens: usize,
    },
    /// "None, direct xyz": tokens are coarse patches without a position; centres are given in the normalised frame.
    DirectXyz {},
}

impl AnchorDesign {
    /// Whether tokens have a position in space.
    pub const fn has_anchors(self) -> bool {
        match self {
            Self::PatchDepth {} => true,
            Self::RayDepth {} | Self::LearnableTokens { .. } | Self::DirectXyz {} => false,
        }
    }

    /// Number of outputs for a Gaussian's position: a depth, or three coordinates.
    pub const fn centre_channels(self) -> usize {
        match self {
            Self::RayDepth {} => 1,
            Self::PatchDepth {} | Self::LearnableTokens { .. } | Self::DirectXyz {} => 3,
        }
    }
}

/// How anchors see their neighbours before decoding.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields, tag = "kind")]
pub enum AnchorContext {
    /// PointNet's `γ ∘ max ∘ h` (Qi et al. 2017, eq. 1) over the nearest anchors, including itself: `h` is a
    /// linear layer over the normalised feature and the offset to the neighbour, `γ` GELU and a linear layer; added
    /// to the feature.
    PointNet {
        /// Number of neighbours; all anchors if there are fewer.
        neighbours: usize,
    },
    /// No context; required for tokens without a position.
    None {},
}
