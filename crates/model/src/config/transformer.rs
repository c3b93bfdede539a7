use serde::{Deserialize, Serialize};

/// Settings of all transformer layers: pre-norm, softmax attention without position embeddings (the Plücker embedding gives
/// positions), erf GELU.
///
/// The paper states only the width (supplement, "Architecture Details"); the rest is that of iLRM (`scalable/transformer.py`), whose
/// normalisation of poses it follows.
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
    /// Normalisation of queries and keys before their product.
    pub query_key_norm: QueryKeyNorm,
}

impl TransformerConfig {
    /// Number of attention heads.
    pub const fn heads(&self) -> usize {
        self.dim / self.head_dim
    }

    /// Hidden channels of a feed-forward module.
    pub const fn hidden_dim(&self) -> usize {
        self.dim.saturating_mul(self.mlp_ratio)
    }
}

/// Normalisation of queries and keys, for each head separately.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields, tag = "kind")]
pub enum QueryKeyNorm {
    /// RMS norm over the head's channels, with a learned weight of `head-dim` channels.
    Rms {
        /// Added to the mean square.
        eps: f64,
    },
    /// None.
    None {},
}
