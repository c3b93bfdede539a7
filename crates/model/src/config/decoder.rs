use serde::{Deserialize, Serialize};

use super::BlockExpansion;

/// The image-to-3D decoder: blocks of layers, each layer cross-attention to the fine features of all views,
/// self-attention among tokens, feed-forward (paper, supplement, "Architecture Details").
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub struct DecoderConfig {
    /// The blocks in order; 4 with 1, 1, 2 and 2 layers in the paper.
    pub blocks: Vec<BlockConfig>,
}

/// One block of the decoder: expansion first, then layers.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub struct BlockConfig {
    /// Decoder layers.
    pub layers: usize,
    /// How many tokens are expanded before the layers; a block without expansion has no expansion weights either.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub expansion: Option<BlockExpansion>,
    /// Whether the expansion takes place. If not, the block keeps its weights and passes tokens through.
    #[serde(default = "yes", skip_serializing_if = "is_true")]
    pub expand: bool,
}

impl BlockConfig {
    /// The expansion that takes place.
    pub const fn active_expansion(&self) -> Option<BlockExpansion> {
        if self.expand { self.expansion } else { None }
    }
}

const fn yes() -> bool {
    true
}

#[expect(clippy::trivially_copy_pass_by_ref, reason = "serde passes a reference")]
const fn is_true(value: &bool) -> bool {
    *value
}
