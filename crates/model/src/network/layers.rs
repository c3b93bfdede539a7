use atsplat_nn::NormKind;
use atsplat_nn::layers::{
    AttentionConfig, Block, BlockConfig, CrossAttention, Linear, LinearConfig, Mlp, MlpConfig, Norm, NormConfig,
};
use burn::Tensor;
use burn::module::Module;
use burn::tensor::Device;

use super::expansion::Expansion;
use crate::config::{ModelConfig, QueryKeyNorm, TransformerConfig};

/// Builds layers with the settings of a configuration.
#[derive(Clone, Copy)]
pub(super) struct LayerBuilder<'a> {
    pub(super) transformer: &'a TransformerConfig,
    pub(super) device: &'a Device,
}

impl LayerBuilder<'_> {
    pub(super) fn linear(self, inputs: usize, outputs: usize) -> Linear {
        LinearConfig::new(inputs, outputs).with_bias(self.transformer.linear_bias).init(self.device)
    }

    pub(super) fn norm(self) -> Norm {
        let config = NormConfig::new(self.transformer.dim).with_bias(self.transformer.norm_bias);
        config.with_epsilon(self.transformer.norm_eps).init(self.device)
    }

    fn attention(self) -> AttentionConfig {
        let bias = self.transformer.linear_bias;
        let config = AttentionConfig::new(self.transformer.dim, self.transformer.heads()).with_qkv_bias(bias);
        match self.transformer.query_key_norm {
            QueryKeyNorm::Rms { eps } => {
                config.with_proj_bias(bias).with_qk_norm(Some(NormKind::Rms)).with_qk_norm_epsilon(eps)
            }
            QueryKeyNorm::None {} => config.with_proj_bias(bias),
        }
    }

    pub(super) fn block(self) -> Block {
        let config = BlockConfig::new(self.attention(), self.transformer.hidden_dim());
        let config = config.with_mlp_bias(self.transformer.linear_bias).with_norm_bias(self.transformer.norm_bias);
        config.with_norm_epsilon(self.transformer.norm_eps).init(self.device)
    }

    pub(super) fn blocks(self, count: usize) -> Vec<Block> {
        (0..count).map(|_| self.block()).collect()
    }

    pub(super) fn head(self, outputs: usize) -> Head {
        let dim = self.transformer.dim;
        let mlp = MlpConfig::new(dim, dim, outputs).with_bias(self.transformer.linear_bias);
        Head { norm: self.norm(), mlp: mlp.init(self.device) }
    }

    fn decoder_layer(self) -> DecoderLayer {
        DecoderLayer {
            cross_norm: self.norm(),
            context_norm: self.norm(),
            cross: self.attention().init_cross(self.transformer.dim, self.device),
            block: self.block(),
        }
    }
}

/// Layer norm and a 2-layer MLP.
#[derive(Module, Debug)]
pub(super) struct Head {
    pub(super) norm: Norm,
    mlp: Mlp,
}

impl Head {
    /// The device of its parameters, which also says whether gradients are recorded.
    pub(super) fn device(&self) -> Device {
        self.norm.gamma.val().device()
    }

    pub(super) fn forward(&self, x: Tensor<3>) -> Tensor<3> {
        self.mlp.forward(self.norm.forward(x))
    }
}

/// Cross-attention to the fine features, then self-attention and feed-forward.
#[derive(Module, Debug)]
pub(super) struct DecoderLayer {
    cross_norm: Norm,
    context_norm: Norm,
    cross: CrossAttention,
    block: Block,
}

impl DecoderLayer {
    pub(super) fn forward(&self, x: Tensor<3>, context: Tensor<3>) -> Tensor<3> {
        let attended = self.cross.forward(self.cross_norm.forward(x.clone()), self.context_norm.forward(context));
        self.block.forward(x + attended)
    }
}

/// The image-to-3D decoder.
#[derive(Module, Debug)]
pub(super) struct Decoder {
    pub(super) blocks: Vec<DecoderBlock>,
}

/// Expansion, then layers.
#[derive(Module, Debug)]
pub(super) struct DecoderBlock {
    pub(super) expansion: Option<Expansion>,
    pub(super) layers: Vec<DecoderLayer>,
}

impl Decoder {
    pub(super) fn new(config: &ModelConfig, builder: LayerBuilder<'_>) -> Self {
        let block = |block: &crate::config::BlockConfig| DecoderBlock {
            expansion: block.expansion.map(|_| Expansion::new(config, builder)),
            layers: (0..block.layers).map(|_| builder.decoder_layer()).collect(),
        };
        Self { blocks: config.decoder.blocks.iter().map(block).collect() }
    }
}
