use burn::Tensor;
use burn::tensor::{Device, Int, TensorData, activation};

use crate::{NormKind, ops};

/// An operation and the same composed of burn's own operations, on flat inputs.
pub(super) struct Case {
    pub(super) name: &'static str,
    /// Elements of each input.
    pub(super) inputs: Vec<usize>,
    pub(super) ours: Function,
    pub(super) burns: Function,
}

pub(super) type Function = fn(&[Tensor<1>]) -> Tensor<1>;

/// Every operation with a gradient, at sizes with incomplete vectors, tiles and blocks of rows.
pub(super) fn all() -> Vec<Case> {
    let case = |name, inputs: &[usize], ours, burns| Case { name, inputs: inputs.to_vec(), ours, burns };
    vec![
        case("linear", &[2 * 35 * 5, 5 * 4, 4], linear, burns_linear),
        case("linear without bias", &[3 * 17, 17], |x| thin(x, true), |x| thin(x, false)),
        case("wide linear without bias", &[12 * 40, 40 * 30], |x| wide(x, true), |x| wide(x, false)),
        case("gelu", &[37], |x| ops::gelu(x[0].clone() * 6.0), |x| activation::gelu(x[0].clone() * 6.0)),
        case("layer norm", &[70 * 21, 21, 21], layer_norm, burns_layer_norm),
        case("rms norm", &[70 * 21, 21], rms_norm, burns_rms_norm),
        case("normalised heads", &[6 * 33, 10, 10], |x| heads(x, true), |x| heads(x, false)),
        case("self-attention", &[2 * 70 * 36], |x| attention(x, 70, 3, true), |x| attention(x, 70, 3, false)),
        case("long self-attention", &[300 * 48], |x| attention(x, 300, 2, true), |x| attention(x, 300, 2, false)),
        case("cross-attention", &[2 * 5 * 12, 2 * 9 * 24], |x| cross(x, true), |x| cross(x, false)),
        case("gathered rows", &[2 * 4 * 3], gather_rows, burns_gather_rows),
        case("largest of rows", &[2 * 4 * 3], gather_max, burns_gather_max),
    ]
}

fn linear(x: &[Tensor<1>]) -> Tensor<1> {
    let weight = x[1].clone().reshape([5, 4]);
    ops::linear(x[0].clone().reshape([2, 35, 5]), weight, Some(x[2].clone())).flatten(0, 2)
}

fn burns_linear(x: &[Tensor<1>]) -> Tensor<1> {
    let weight = x[1].clone().reshape([1, 5, 4]);
    (x[0].clone().reshape([2, 35, 5]).matmul(weight) + x[2].clone().reshape([1, 1, 4])).flatten(0, 2)
}

fn thin(x: &[Tensor<1>], ours: bool) -> Tensor<1> {
    let (rows, weight) = (x[0].clone().reshape([3, 17]), x[1].clone().reshape([17, 1]));
    if ours { ops::linear(rows, weight, None) } else { rows.matmul(weight) }.flatten(0, 1)
}

fn wide(x: &[Tensor<1>], ours: bool) -> Tensor<1> {
    let (rows, weight) = (x[0].clone().reshape([12, 40]), x[1].clone().reshape([40, 30]));
    if ours { ops::linear(rows, weight, None) } else { rows.matmul(weight) }.flatten(0, 1)
}

fn layer_norm(x: &[Tensor<1>]) -> Tensor<1> {
    ops::layer_norm(x[0].clone().reshape([70, 21]), x[1].clone(), Some(x[2].clone()), 1e-3).flatten(0, 1)
}

fn burns_layer_norm(x: &[Tensor<1>]) -> Tensor<1> {
    let rows = x[0].clone().reshape([70, 21]);
    (standard(rows, NormKind::Layer, 1e-3) * x[1].clone().unsqueeze() + x[2].clone().unsqueeze()).flatten(0, 1)
}

fn rms_norm(x: &[Tensor<1>]) -> Tensor<1> {
    ops::rms_norm(x[0].clone().reshape([70, 21]), x[1].clone(), 1e-3).flatten(0, 1)
}

fn burns_rms_norm(x: &[Tensor<1>]) -> Tensor<1> {
    let rows = x[0].clone().reshape([70, 21]);
    (standard(rows, NormKind::Rms, 1e-3) * x[1].clone().unsqueeze()).flatten(0, 1)
}

fn standard<const D: usize>(x: Tensor<D>, kind: NormKind, epsilon: f64) -> Tensor<D> {
    let off = if kind == NormKind::Layer { x.clone() - x.mean_dim(D - 1) } else { x };
    let spread = ((off.clone() * off.clone()).mean_dim(D - 1) + epsilon).sqrt();
    off / spread
}

/// Two parts of two heads of five elements, and thirteen elements that are not changed.
fn heads(x: &[Tensor<1>], ours: bool) -> Tensor<1> {
    let rows = x[0].clone().reshape([6, 33]);
    let (gamma, beta) = (x[1].clone().reshape([2, 5]), x[2].clone().reshape([2, 5]));
    if ours {
        return ops::normalize_heads(rows, 2, gamma, Some(beta), NormKind::Layer, 1e-3).flatten(0, 1);
    }
    let normalised = standard(rows.clone().slice([0..6, 0..20]).reshape([6, 2, 2, 5]), NormKind::Layer, 1e-3);
    let normalised = normalised * gamma.reshape([1, 2, 1, 5]) + beta.reshape([1, 2, 1, 5]);
    Tensor::cat(vec![normalised.reshape([6, 20]), rows.slice([0..6, 20..33])], 1).flatten(0, 1)
}

fn attention(x: &[Tensor<1>], tokens: usize, heads: usize, ours: bool) -> Tensor<1> {
    let batch = if tokens == 70 { 2 } else { 1 };
    let width = x[0].dims()[0] / (batch * tokens * 3);
    let packed = (x[0].clone() * 2.0).reshape([batch, tokens, 3 * width]);
    if ours {
        return ops::self_attention(packed, heads).flatten(0, 2);
    }
    let part = |at| packed.clone().slice([0..batch, 0..tokens, at * width..(at + 1) * width]);
    decomposed([part(0), part(1), part(2)], heads).flatten(0, 2)
}

fn cross(x: &[Tensor<1>], ours: bool) -> Tensor<1> {
    let queries = x[0].clone().reshape([2, 5, 12]);
    let keys_values = x[1].clone().reshape([2, 9, 24]);
    if ours {
        return ops::cross_attention(queries, keys_values, 2).flatten(0, 2);
    }
    let part = |at| keys_values.clone().slice([0..2, 0..9, at * 12..(at + 1) * 12]);
    decomposed([queries, part(0), part(1)], 2).flatten(0, 2)
}

/// Attention with all weights stored.
pub(super) fn decomposed(parts: [Tensor<3>; 3], heads: usize) -> Tensor<3> {
    let [batch, queries, width] = parts[0].dims();
    let [q, k, v] = parts.map(|part| {
        let tokens = part.dims()[1];
        part.reshape([batch, tokens, heads, width / heads]).swap_dims(1, 2)
    });
    let logits = q.matmul(k.swap_dims(2, 3)) / ((width / heads) as f64).sqrt();
    activation::softmax(logits, 3).matmul(v).swap_dims(1, 2).reshape([batch, queries, width])
}

fn numbers<const D: usize>(numbers: &[i64], shape: [usize; D], device: &Device) -> Tensor<D, Int> {
    Tensor::from_data(TensorData::new(numbers.to_vec(), shape), device)
}

const PICKS: [i64; 12] = [3, 0, 3, 1, 1, 2, 0, 0, 2, 3, 2, 2];

fn gather_rows(x: &[Tensor<1>]) -> Tensor<1> {
    ops::gather_rows(x[0].clone().reshape([2, 4, 3]), numbers(&PICKS, [2, 6], &x[0].device())).flatten(0, 2)
}

fn burns_gather_rows(x: &[Tensor<1>]) -> Tensor<1> {
    let picks = numbers(&PICKS, [2, 6, 1], &x[0].device()).expand([2, 6, 3]);
    x[0].clone().reshape([2, 4, 3]).gather(1, picks).flatten(0, 2)
}

fn gather_max(x: &[Tensor<1>]) -> Tensor<1> {
    ops::gather_max(x[0].clone().reshape([2, 4, 3]), numbers(&PICKS, [2, 2, 3], &x[0].device())).flatten(0, 2)
}

fn burns_gather_max(x: &[Tensor<1>]) -> Tensor<1> {
    burns_gather_rows(x).reshape([2, 2, 3, 3]).max_dim(2).flatten(0, 3)
}
