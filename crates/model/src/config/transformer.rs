use serde::{Deserialize, Serialize};

/// What all transformer layers of the network share; pre-norm, softmax attention without positions (those
/// come with the Plücker embedding), GELU of the error function.
///
/// The paper states the width alone (supplement, "Architecture Details"); the rest follows iLRM
/// (`scalable/transformer.py`), whose authors it builds on.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub struct TransformerConfig {
    /// Channels of every token.
    pub dim: usize,
    /// Channels of an attention head; divides `dim`.
    pub head_dim: usize,
    /// Hidden channels of a feed-forward module, in multiples of `dim`.
    pub mlp_ratio: usize,
    /// Whether linear layers have a bias.
    pub linear_bias: bool,
    /// Whether layer norms have a bias.
    pub norm_bias: bool,
    /// Added to the variance in layer norms.
    pub norm_eps: f64,
    /// What is done to queries and keys before their product.
    pub query_key_norm: QueryKeyNorm,
}

impl TransformerConfig {
    /// Attention heads.
    pub const fn heads(&self) -> usize {
        match self.dim.checked_div(self.head_dim) {
            Some(heads) => heads,
            None => 0,
        }
    }

    /// Hidden channels of a feed-forward module.
    pub const fn hidden_dim(&self) -> usize {
        self.dim.saturating_mul(self.mlp_ratio)
    }
}

/// Normalisation of queries and keys, each head by itself.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields, tag = "kind")]
pub enum QueryKeyNorm {
    /// Root mean square of the head's channels becomes 1, times a learnt weight of `head-dim` channels.
    Rms {
        /// Added to the mean square.
        eps: f64,
    },
    /// None.
    None {},
}
