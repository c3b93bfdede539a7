use atsplat_numeric::Tolerance;
use burn::Tensor;
use burn::module::{Module, Param};
use burn::tensor::{Device, activation};

use super::{cases, random, values};
use crate::NormKind;
use crate::layers::{AttentionConfig, BlockConfig, Linear, Norm};

const SINGLE: Tolerance = Tolerance { absolute: 1e-5, relative: 1e-5 };

fn linear(layer: &Linear, x: Tensor<3>) -> Tensor<3> {
    x.matmul(layer.weight.val().unsqueeze()) + layer.bias.as_ref().map(Param::val).unwrap().unsqueeze()
}

fn norm<const D: usize>(layer: &Norm, x: Tensor<D>) -> Tensor<D> {
    let off = if layer.kind == NormKind::Layer { x.clone() - x.mean_dim(D - 1) } else { x };
    let spread = ((off.clone() * off.clone()).mean_dim(D - 1) + layer.epsilon).sqrt();
    let scaled = off / spread * layer.gamma.val().unsqueeze();
    match &layer.beta {
        Some(beta) => scaled + beta.val().unsqueeze(),
        None => scaled,
    }
}

fn norm_heads(layer: &Norm, x: Tensor<3>, heads: usize) -> Tensor<3> {
    let [batch, tokens, width] = x.dims();
    norm(layer, x.reshape([batch, tokens, heads, width / heads])).reshape([batch, tokens, width])
}

/// Replaces every parameter by random values, so that no bias is 0 and no scale 1.
fn shuffled<M: Module>(module: M) -> M {
    struct Shuffle(u64);
    impl burn::module::ModuleMapper for Shuffle {
        fn map_float<const D: usize>(&mut self, parameter: Param<Tensor<D>>) -> Param<Tensor<D>> {
            self.0 += 1;
            let seed = self.0;
            parameter.map(|value| random(value.dims(), seed) * 0.3 + 0.1)
        }
    }
    module.map(&mut Shuffle(0))
}

#[test]
fn a_block_equals_the_composition_of_its_parts() {
    let device = Device::flex();
    for kind in [NormKind::Rms, NormKind::Layer] {
        let attention = AttentionConfig::new(24, 3).with_qk_norm(Some(kind));
        let block = shuffled(BlockConfig::new(attention, 40).with_layer_scale(Some(0.1)).init(&device));
        let x = random::<3>([2, 9, 24], 77);

        let packed = linear(&block.attn.qkv, norm(&block.norm1, x.clone()));
        let part = |at: usize| packed.clone().slice([0..2, 0..9, at * 24..(at + 1) * 24]);
        let (q_norm, k_norm) = (block.attn.q_norm.as_ref().unwrap(), block.attn.k_norm.as_ref().unwrap());
        let parts = [norm_heads(q_norm, part(0), 3), norm_heads(k_norm, part(1), 3), part(2)];
        let attended = linear(&block.attn.proj, cases::decomposed(parts, 3));
        let scale = |scale: &Option<crate::layers::LayerScale>| scale.as_ref().unwrap().gamma.val().unsqueeze();
        let middle = x.clone() + attended * scale(&block.ls1);
        let hidden = activation::gelu(linear(&block.mlp.fc1, norm(&block.norm2, middle.clone())));
        let expected = middle + linear(&block.mlp.fc2, hidden) * scale(&block.ls2);

        SINGLE.assert(values(block.forward(x)), values(expected), "block");
    }
}

/// With one head, the keys of packed `[k, v]` are the only segment of a row, and half of it.
#[test]
fn cross_attention_equals_the_composition_of_its_parts() {
    for (heads, kind) in [(3, NormKind::Layer), (1, NormKind::Layer), (1, NormKind::Rms)] {
        let config = AttentionConfig::new(24, heads).with_qk_norm(Some(kind));
        let layer = shuffled(config.init_cross(10, &Device::flex()));
        let (x, context) = (random::<3>([2, 5, 24], 1), random::<3>([2, 7, 10], 2));
        let packed = linear(&layer.kv, context.clone());
        let part = |at: usize| packed.clone().slice([0..2, 0..7, at * 24..(at + 1) * 24]);
        let queries = norm_heads(layer.q_norm.as_ref().unwrap(), linear(&layer.q, x.clone()), heads);
        let parts = [queries, norm_heads(layer.k_norm.as_ref().unwrap(), part(0), heads), part(1)];
        let expected = linear(&layer.proj, cases::decomposed(parts, heads));
        SINGLE.assert(values(layer.forward(x, context)), values(expected), &format!("{heads} heads, {kind:?}"));
    }
}

/// The current path, and the paths of all parameters.
struct Names(Vec<String>, Vec<String>);

impl burn::module::ModuleVisitor for Names {
    fn visit_float<const D: usize>(&mut self, _: &Param<Tensor<D>>) {
        self.1.push(self.0.join("."));
    }
    fn enter_module(&mut self, name: &str, _: &str) {
        self.0.push(name.to_owned());
    }
    fn exit_module(&mut self, _: &str, _: &str) {
        self.0.pop();
    }
}

#[test]
fn parameters_have_the_documented_names() {
    let attention = AttentionConfig::new(8, 2).with_qk_norm(Some(NormKind::Layer)).with_qkv_bias(false);
    let block = BlockConfig::new(attention, 16).with_layer_scale(Some(1.0)).init(&Device::flex());
    let mut names = Names(Vec::new(), Vec::new());
    block.visit(&mut names);
    let expected = [
        "norm1.gamma",
        "norm1.beta",
        "attn.qkv.weight",
        "attn.q_norm.gamma",
        "attn.q_norm.beta",
        "attn.k_norm.gamma",
        "attn.k_norm.beta",
        "attn.proj.weight",
        "attn.proj.bias",
        "ls1.gamma",
        "norm2.gamma",
        "norm2.beta",
        "mlp.fc1.weight",
        "mlp.fc1.bias",
        "mlp.fc2.weight",
        "mlp.fc2.bias",
        "ls2.gamma",
    ];
    assert_eq!(names.1, expected);
}
