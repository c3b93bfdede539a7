use burn::Tensor;
use burn::config::Config;
use burn::module::{Initializer, Module};
use burn::tensor::Device;

use super::{Linear, LinearConfig, Norm, NormConfig};
use crate::{NormKind, ops};

/// Configuration of a [`SelfAttention`] or a [`CrossAttention`].
#[derive(Config, Debug)]
pub struct AttentionConfig {
    /// Elements of a token.
    pub width: usize,
    /// Number of heads, which divides the width.
    pub heads: usize,
    /// Whether queries, keys and values get a bias.
    #[config(default = true)]
    pub qkv_bias: bool,
    /// Whether the projection of the result gets a bias.
    #[config(default = true)]
    pub proj_bias: bool,
    /// Normalisation of each head of queries and keys, if any.
    #[config(default = "None")]
    pub qk_norm: Option<NormKind>,
    /// Epsilon of the normalisation of queries and keys.
    #[config(default = 1e-5)]
    pub qk_norm_epsilon: f64,
    /// Initialiser of the weights.
    #[config(default = "Initializer::Normal { mean: 0.0, std: 0.02 }")]
    pub initializer: Initializer,
}

impl AttentionConfig {
    /// A self-attention layer.
    ///
    /// # Panics
    /// If the heads do not divide the width.
    pub fn init_self(&self, device: &Device) -> SelfAttention {
        SelfAttention {
            qkv: self.linear(3 * self.width, self.qkv_bias, device),
            q_norm: self.norm(device),
            k_norm: self.norm(device),
            proj: self.linear(self.width, self.proj_bias, device),
            heads: self.heads,
        }
    }

    /// A cross-attention layer to context tokens of `context_width` elements.
    ///
    /// # Panics
    /// If the heads do not divide the width.
    pub fn init_cross(&self, context_width: usize, device: &Device) -> CrossAttention {
        let key_values = LinearConfig::new(context_width, 2 * self.width).with_bias(self.qkv_bias);
        CrossAttention {
            q: self.linear(self.width, self.qkv_bias, device),
            kv: key_values.with_initializer(self.initializer.clone()).init(device),
            q_norm: self.norm(device),
            k_norm: self.norm(device),
            proj: self.linear(self.width, self.proj_bias, device),
            heads: self.heads,
        }
    }

    fn linear(&self, outputs: usize, bias: bool, device: &Device) -> Linear {
        let config = LinearConfig::new(self.width, outputs).with_bias(bias);
        config.with_initializer(self.initializer.clone()).init(device)
    }

    fn norm(&self, device: &Device) -> Option<Norm> {
        let Self { width, heads, .. } = *self;
        assert!(heads > 0 && width.is_multiple_of(heads), "expected a width divisible by {heads} heads, found {width}");
        let config = |kind| NormConfig::new(width / heads).with_kind(kind).with_epsilon(self.qk_norm_epsilon);
        self.qk_norm.map(|kind| config(kind).init(device))
    }
}

/// Self-attention.
#[derive(Module, Debug)]
pub struct SelfAttention {
    /// Projection to packed queries, keys and values.
    pub qkv: Linear,
    /// Norm of each head of the queries.
    pub q_norm: Option<Norm>,
    /// Norm of each head of the keys.
    pub k_norm: Option<Norm>,
    /// Projection of the result.
    pub proj: Linear,
    #[module(skip)]
    heads: usize,
}

impl SelfAttention {
    /// `[batch, tokens, width]` to the same.
    ///
    /// # Panics
    /// If the shapes do not fit.
    pub fn forward(&self, x: Tensor<3>) -> Tensor<3> {
        let mut packed = self.qkv.forward(x);
        if let (Some(q_norm), Some(k_norm)) = (&self.q_norm, &self.k_norm) {
            packed = Norm::heads(&[q_norm, k_norm], packed, self.heads);
        }
        self.proj.forward(ops::self_attention(packed, self.heads))
    }
}

/// Cross-attention.
#[derive(Module, Debug)]
pub struct CrossAttention {
    /// Projection to queries.
    pub q: Linear,
    /// Projection of the context to packed keys and values.
    pub kv: Linear,
    /// Norm of each head of the queries.
    pub q_norm: Option<Norm>,
    /// Norm of each head of the keys.
    pub k_norm: Option<Norm>,
    /// Projection of the result.
    pub proj: Linear,
    #[module(skip)]
    heads: usize,
}

impl CrossAttention {
    /// `[batch, queries, width]` and `[batch, keys, context_width]` to `[batch, queries, width]`.
    ///
    /// # Panics
    /// If the shapes do not fit.
    pub fn forward(&self, x: Tensor<3>, context: Tensor<3>) -> Tensor<3> {
        let (mut queries, mut keys_values) = (self.q.forward(x), self.kv.forward(context));
        if let (Some(q_norm), Some(k_norm)) = (&self.q_norm, &self.k_norm) {
            queries = Norm::heads(&[q_norm], queries, self.heads);
            keys_values = Norm::heads(&[k_norm], keys_values, self.heads);
        }
        self.proj.forward(ops::cross_attention(queries, keys_values, self.heads))
    }
}
