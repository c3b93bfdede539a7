//! Names and shapes of a configuration's parameters: the contract between the network, weights files, key maps and the
//! PyTorch reference in `oracle/`. `NAMES.md` explains the scheme.

use crate::config::{
    AnchorContext, AnchorDesign, BackboneConfig, DinoArchitecture, ModelConfig, QueryKeyNorm, TransformerConfig,
};

/// Number of Plücker coordinates of a ray.
const PLUCKER: usize = 6;
/// Number of colour channels.
const RGB: usize = 3;

/// Name and shape of an array.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Parameter {
    /// Path in the network, parts separated by dots.
    pub name: String,
    /// Dimensions, row-major; linear layers are `[outputs, inputs]` as in PyTorch.
    pub shape: Vec<usize>,
    /// Whether it is trained; the DINOv2 backbone is frozen.
    pub trained: bool,
}

impl Parameter {
    /// Number of elements.
    pub fn elements(&self) -> usize {
        self.shape.iter().product()
    }
}

/// All parameters of a configuration, in the order of the forward pass.
pub fn parameters(config: &ModelConfig) -> Vec<Parameter> {
    let mut list = List { prefix: String::new(), transformer: &config.transformer, parameters: Vec::new() };
    let dim = config.transformer.dim;
    match config.backbone {
        BackboneConfig::DinoV2 { size, registers } => list.dino(&DinoArchitecture::new(size, registers)),
        BackboneConfig::Patch { layers } => {
            let patch = config.coarse.patch_size.pow(2);
            list.linear("backbone.embed", patch * (RGB + PLUCKER), dim);
            for layer in 0..layers {
                list.within(format!("backbone.layers.{layer}"), List::block);
            }
        }
    }
    coarse(config, &mut list);
    anchors(config, &mut list);
    list.within("fine", |list| {
        let patch = config.fine.patch_size.pow(2);
        list.linear("patch", patch * RGB, dim);
        list.linear("plucker", patch * PLUCKER, dim);
        for layer in 0..config.fine.layers {
            list.within(format!("layers.{layer}"), List::block);
        }
    });
    decoder(config, &mut list);
    let channels = config.head.channels(config.anchors.design.centre_channels());
    list.within("head", |list| list.head(config.head.gaussians_per_token * channels));
    list.parameters
}

fn coarse(config: &ModelConfig, list: &mut List<'_>) {
    let dim = config.transformer.dim;
    let patch = config.coarse.patch_size.pow(2);
    list.within("coarse", |list| {
        list.linear("patch", patch * RGB, dim);
        list.linear("fuse", config.backbone.dim(dim) + dim, dim);
        list.linear("plucker", patch * PLUCKER, dim);
        for layer in 0..config.coarse.layers {
            list.within(format!("layers.{layer}"), List::block);
        }
    });
}

fn anchors(config: &ModelConfig, list: &mut List<'_>) {
    let dim = config.transformer.dim;
    match config.anchors.design {
        AnchorDesign::PatchDepth {} => list.within("anchors.depth", |list| list.head(1)),
        AnchorDesign::LearnableTokens { tokens } => list.push("anchors.tokens", vec![tokens, dim], true),
        AnchorDesign::RayDepth {} | AnchorDesign::DirectXyz {} => {}
    }
    if let AnchorContext::PointNet { .. } = config.anchors.context {
        list.within("anchors.context", |list| {
            list.norm("norm");
            list.linear("fc1", dim + 3, dim);
            list.linear("fc2", dim, dim);
        });
    }
}

fn decoder(config: &ModelConfig, list: &mut List<'_>) {
    let dim = config.transformer.dim;
    let scored = config.expansion.selection.is_scored();
    for (position, block) in config.decoder.blocks.iter().enumerate() {
        list.within(format!("decoder.blocks.{position}"), |list| {
            if block.expansion.is_some() {
                if scored {
                    list.within("expansion.score", |list| list.head(1));
                }
                list.linear("expansion.children", dim, config.expansion.children * dim);
            }
            for layer in 0..block.layers {
                list.within(format!("layers.{layer}"), List::decoder_layer);
            }
        });
    }
}

/// A list of parameters whose names get a prefix.
struct List<'a> {
    prefix: String,
    transformer: &'a TransformerConfig,
    parameters: Vec<Parameter>,
}

impl List<'_> {
    fn within(&mut self, name: impl AsRef<str>, add: impl FnOnce(&mut Self)) {
        let length = self.prefix.len();
        self.prefix.push_str(name.as_ref());
        self.prefix.push('.');
        add(self);
        self.prefix.truncate(length);
    }

    fn push(&mut self, name: &str, shape: Vec<usize>, trained: bool) {
        self.parameters.push(Parameter { name: format!("{}{name}", self.prefix), shape, trained });
    }

    fn linear(&mut self, name: &str, inputs: usize, outputs: usize) {
        self.push(&format!("{name}.weight"), vec![outputs, inputs], true);
        if self.transformer.linear_bias {
            self.push(&format!("{name}.bias"), vec![outputs], true);
        }
    }

    fn norm(&mut self, name: &str) {
        self.push(&format!("{name}.weight"), vec![self.transformer.dim], true);
        if self.transformer.norm_bias {
            self.push(&format!("{name}.bias"), vec![self.transformer.dim], true);
        }
    }

    /// Linear, GELU, linear.
    fn mlp(&mut self, hidden: usize, outputs: usize) {
        let dim = self.transformer.dim;
        self.within("mlp", |list| {
            list.linear("fc1", dim, hidden);
            list.linear("fc2", hidden, outputs);
        });
    }

    /// Layer norm and an MLP.
    fn head(&mut self, outputs: usize) {
        self.norm("norm");
        self.mlp(self.transformer.dim, outputs);
    }

    fn query_key_norms(&mut self) {
        if let QueryKeyNorm::Rms { .. } = self.transformer.query_key_norm {
            self.push("q_norm.weight", vec![self.transformer.head_dim], true);
            self.push("k_norm.weight", vec![self.transformer.head_dim], true);
        }
    }

    /// Self-attention and feed-forward.
    fn block(&mut self) {
        let dim = self.transformer.dim;
        self.norm("norm1");
        self.within("attn", |list| {
            list.linear("qkv", dim, 3 * dim);
            list.query_key_norms();
            list.linear("proj", dim, dim);
        });
        self.norm("norm2");
        self.mlp(self.transformer.hidden_dim(), dim);
    }

    /// Cross-attention and a block.
    fn decoder_layer(&mut self) {
        let dim = self.transformer.dim;
        self.norm("cross_norm");
        self.norm("context_norm");
        self.within("cross", |list| {
            list.linear("q", dim, dim);
            list.linear("kv", dim, 2 * dim);
            list.query_key_norms();
            list.linear("proj", dim, dim);
        });
        self.within("block", Self::block);
    }

    /// DINOv2 by the names of the official checkpoints, under `backbone.`.
    fn dino(&mut self, dino: &DinoArchitecture) {
        let (dim, hidden) = (dino.dim, dino.dim * DinoArchitecture::MLP_RATIO);
        let patch = DinoArchitecture::PATCH_SIZE;
        self.within("backbone", |list| {
            let mut frozen = |name: &str, shape: &[usize]| list.push(name, shape.to_vec(), false);
            frozen("cls_token", &[1, 1, dim]);
            frozen("pos_embed", &[1, dino.position_side.pow(2) + 1, dim]);
            if dino.registers > 0 {
                frozen("register_tokens", &[1, dino.registers, dim]);
            }
            frozen("patch_embed.proj.weight", &[dim, RGB, patch, patch]);
            frozen("patch_embed.proj.bias", &[dim]);
            for layer in 0..dino.layers {
                for (name, shape) in [
                    ("norm1.weight", &[dim][..]),
                    ("norm1.bias", &[dim]),
                    ("attn.qkv.weight", &[3 * dim, dim]),
                    ("attn.qkv.bias", &[3 * dim]),
                    ("attn.proj.weight", &[dim, dim]),
                    ("attn.proj.bias", &[dim]),
                    ("ls1.gamma", &[dim]),
                    ("norm2.weight", &[dim]),
                    ("norm2.bias", &[dim]),
                    ("mlp.fc1.weight", &[hidden, dim]),
                    ("mlp.fc1.bias", &[hidden]),
                    ("mlp.fc2.weight", &[dim, hidden]),
                    ("mlp.fc2.bias", &[dim]),
                    ("ls2.gamma", &[dim]),
                ] {
                    frozen(&format!("blocks.{layer}.{name}"), shape);
                }
            }
            frozen("norm.weight", &[dim]);
            frozen("norm.bias", &[dim]);
        });
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn count(name: &str, trained: bool) -> usize {
        let all = parameters(&ModelConfig::named(name).unwrap());
        all.iter().filter(|parameter| parameter.trained == trained).map(Parameter::elements).sum()
    }

    #[test]
    fn dino_has_the_published_parameter_count() {
        // `timm` and the model card: 86.58 M with the mask token, which inference does not use.
        assert_eq!(count("paper-re10k", false), 86_580_480 - 768);
    }

    #[test]
    fn names_are_unique_and_small_models_are_small() {
        for name in ModelConfig::names() {
            let all = parameters(&ModelConfig::named(name).unwrap());
            let unique: std::collections::BTreeSet<_> = all.iter().map(|parameter| &parameter.name).collect();
            assert_eq!(unique.len(), all.len(), "{name}");
        }
        let (mini, nano) = (count("mini", true), count("nano", true));
        assert!(mini * 2 < 20_000_000, "f16 weights of mini stay below 20 MB: {mini}");
        assert!(nano * 4 < mini, "nano is much smaller: {nano}");
        assert_eq!((count("mini", false), count("nano", false)), (0, 0));
    }
}
