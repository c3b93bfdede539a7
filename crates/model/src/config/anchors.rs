use serde::{Deserialize, Serialize};

use super::DepthActivation;

/// Where tokens are in space (paper, "Initializing sparse anchor tokens" and "3D anchor designs").
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub struct AnchorConfig {
    /// The row of the paper's ablation.
    pub design: AnchorDesign,
    /// What the depth head's output means: distance along the unit ray, in scene units.
    pub depth: DepthActivation,
    /// What anchors learn of their neighbours.
    pub context: AnchorContext,
}

/// What a token starts from, and what the centres of its Gaussians are relative to.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields, tag = "kind")]
pub enum AnchorDesign {
    /// "Patch depth, anchor + offset", the paper's: a depth per coarse patch, unprojected along the unit ray
    /// through the patch's centre; centres are offsets from there.
    PatchDepth {},
    /// "None, ray + depth": tokens are coarse patches without a place. A patch is divided into as many cells
    /// as a token has Gaussians, and each Gaussian lies on the ray through its cell's centre, at a depth that
    /// the Gaussian head gives instead of an offset. Children share their parent's rays.
    RayDepth {},
    /// "Learnable, direct xyz": a learnt set of tokens, the same for every scene; centres are given in the
    /// normalised frame.
    LearnableTokens {
        /// How many.
        tokens: usize,
    },
    /// "None, direct xyz": tokens are coarse patches without a place; centres are given in the normalised frame.
    DirectXyz {},
}

impl AnchorDesign {
    /// Whether tokens have a place in space.
    pub const fn has_anchors(self) -> bool {
        matches!(self, Self::PatchDepth {})
    }

    /// Numbers that say where a Gaussian is: a depth, or three coordinates.
    pub const fn centre_channels(self) -> usize {
        match self {
            Self::RayDepth {} => 1,
            Self::PatchDepth {} | Self::LearnableTokens { .. } | Self::DirectXyz {} => 3,
        }
    }
}

/// What anchors learn of their neighbours before decoding.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields, tag = "kind")]
pub enum AnchorContext {
    /// PointNet's `γ ∘ max ∘ h` (Qi et al. 2017, eq. 1) over the nearest anchors, itself among them: `h` is a
    /// linear layer over the normalised feature and the offset to the neighbour, `γ` GELU and a linear layer; added
    /// to the feature.
    PointNet {
        /// How many neighbours; all where there are fewer anchors.
        neighbours: usize,
    },
    /// Nothing: always so for tokens without a place.
    None {},
}
