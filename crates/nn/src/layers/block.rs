use burn::Tensor;
use burn::config::Config;
use burn::module::{Initializer, Module, Param};
use burn::tensor::Device;

use super::{AttentionConfig, Mlp, MlpConfig, Norm, NormConfig, SelfAttention};

/// Configuration of a [`Block`].
#[derive(Config, Debug)]
pub struct BlockConfig {
    /// The attention, whose width is the block's.
    pub attention: AttentionConfig,
    /// Hidden elements of the MLP.
    pub hidden: usize,
    /// Whether the layers of the MLP add a bias.
    #[config(default = true)]
    pub mlp_bias: bool,
    /// Whether the layer norms add a bias.
    #[config(default = true)]
    pub norm_bias: bool,
    /// Epsilon of the layer norms.
    #[config(default = 1e-5)]
    pub norm_epsilon: f64,
    /// Initial value of each [`LayerScale`], if there are any.
    #[config(default = "None")]
    pub layer_scale: Option<f64>,
}

impl BlockConfig {
    /// A block with newly initialised parameters.
    ///
    /// # Panics
    /// If the heads do not divide the width.
    pub fn init(&self, device: &Device) -> Block {
        let width = self.attention.width;
        let norm = || NormConfig::new(width).with_bias(self.norm_bias).with_epsilon(self.norm_epsilon).init(device);
        let scale = || {
            let gamma = |value| LayerScale { gamma: Initializer::Constant { value }.init([width], device) };
            self.layer_scale.map(gamma)
        };
        let mlp = MlpConfig::new(width, self.hidden, width).with_bias(self.mlp_bias);
        Block {
            norm1: norm(),
            attn: self.attention.init_self(device),
            ls1: scale(),
            norm2: norm(),
            mlp: mlp.with_initializer(self.attention.initializer.clone()).init(device),
            ls2: scale(),
        }
    }
}

/// A pre-norm transformer block: `x + ls1(attn(norm1(x)))`, then `x + ls2(mlp(norm2(x)))`.
///
/// Names are those of `DINOv2` (`dinov2/layers/block.py`).
#[derive(Module, Debug)]
pub struct Block {
    /// Norm before the attention.
    pub norm1: Norm,
    /// Attention.
    pub attn: SelfAttention,
    /// Scale after the attention.
    pub ls1: Option<LayerScale>,
    /// Norm before the MLP.
    pub norm2: Norm,
    /// MLP.
    pub mlp: Mlp,
    /// Scale after the MLP.
    pub ls2: Option<LayerScale>,
}

impl Block {
    /// `[batch, tokens, width]` to the same.
    ///
    /// # Panics
    /// If the shapes do not fit.
    pub fn forward(&self, x: Tensor<3>) -> Tensor<3> {
        let attended = self.attn.forward(self.norm1.forward(x.clone()));
        let x = x + scaled(self.ls1.as_ref(), attended);
        let changed = self.mlp.forward(self.norm2.forward(x.clone()));
        x + scaled(self.ls2.as_ref(), changed)
    }
}

fn scaled(scale: Option<&LayerScale>, x: Tensor<3>) -> Tensor<3> {
    match scale {
        Some(scale) => scale.forward(x),
        None => x,
    }
}

/// A learned factor per element of a token (Touvron et al. 2021, "Going deeper with image transformers").
#[derive(Module, Debug)]
pub struct LayerScale {
    /// `[width]`.
    pub gamma: Param<Tensor<1>>,
}

impl LayerScale {
    /// `[…, width]` to the same.
    ///
    /// # Panics
    /// If the last dimension is not of `width` elements.
    pub fn forward<const D: usize>(&self, x: Tensor<D>) -> Tensor<D> {
        x * self.gamma.val().unsqueeze()
    }
}
