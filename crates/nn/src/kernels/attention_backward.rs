use pulp::{Simd, WithSimd};
use rayon::prelude::*;

use super::attention::{Inputs, QUERIES, Sizes, Tile, Tokens};
use super::matrix::{Matrix, Output, Threads, Write, multiply};
use super::simd::{self, Exp};

/// The gradients of queries, keys and values of one head of a sample, tokens in rows.
#[derive(Debug)]
pub(crate) struct HeadGradients {
    pub(crate) queries: Vec<f32>,
    pub(crate) keys: Vec<f32>,
    pub(crate) values: Vec<f32>,
}

/// The backward pass of attention: `out` and `log_sums` are results of the forward pass, `grad` is the gradient of `out`.
///
/// Logits are computed again, tile by tile. One task computes a whole head, so that sums run over tiles in order. The result
/// is ordered by sample, then head.
pub(crate) fn backward(inputs: &Inputs<'_>, out: &[f32], log_sums: &[f32], grad: &[f32]) -> Vec<HeadGradients> {
    let heads = inputs.sizes.heads;
    let tasks = (0..inputs.sizes.batch * heads).into_par_iter();
    tasks.map(|task| differentiate(inputs, out, log_sums, grad, task / heads, task % heads)).collect()
}

/// Packs the gradients of heads into `[batch, tokens, stride]`, one kind after the other.
pub(crate) fn pack(
    gradients: &[HeadGradients],
    kinds: &[fn(&HeadGradients) -> &[f32]],
    tokens: usize,
    sizes: &Sizes,
) -> Vec<f32> {
    let (width, head_width, heads) = (sizes.width(), sizes.head_width, sizes.heads);
    let stride = kinds.len() * width;
    let mut out = vec![0.0; sizes.batch * tokens * stride];
    if out.is_empty() {
        return out;
    }
    out.par_chunks_mut(stride).enumerate().for_each(|(row, out)| {
        let (sample, token) = (row / tokens, row % tokens);
        for (out, kind) in out.chunks_exact_mut(width).zip(kinds) {
            let heads = &gradients[sample * heads..(sample + 1) * heads];
            for (out, head) in out.chunks_exact_mut(head_width).zip(heads) {
                out.copy_from_slice(&kind(head)[token * head_width..(token + 1) * head_width]);
            }
        }
    });
    out
}

fn differentiate(
    inputs: &Inputs<'_>,
    out: &[f32],
    log_sums: &[f32],
    grad: &[f32],
    sample: usize,
    head: usize,
) -> HeadGradients {
    let sizes = &inputs.sizes;
    let head_width = sizes.head_width;
    let mut gradients = HeadGradients {
        queries: vec![0.0; sizes.queries * head_width],
        keys: vec![0.0; sizes.keys * head_width],
        values: vec![0.0; sizes.keys * head_width],
    };
    let grad = Tokens { data: grad, count: sizes.queries, stride: sizes.width(), offset: 0 };
    let tiles: Vec<_> = (0..sizes.queries)
        .step_by(QUERIES)
        .map(|first| Tile { sample, head, first, count: QUERIES.min(sizes.queries - first) })
        .map(|at| QueryTile::new(inputs, out, log_sums, &grad, at))
        .collect();
    let tile = sizes.key_tile();
    let mut weights = vec![0.0; tile * QUERIES];
    let mut slopes = vec![0.0; tile * QUERIES];
    let keys_of = gradients.keys.chunks_mut(tile * head_width).zip(gradients.values.chunks_mut(tile * head_width));
    for (index, (by_keys, by_values)) in keys_of.enumerate() {
        let (first_key, keys) = (index * tile, by_keys.len() / head_width);
        for query_tile in &tiles {
            let at = query_tile.at;
            let (weights, slopes) = (&mut weights[..keys * at.lanes()], &mut slopes[..keys * at.lanes()]);
            query_tile.weigh(inputs, weights, slopes, first_key, keys);
            // Lanes beyond the tile's queries are not part of the sums.
            let lanes = at.lanes();
            let of_queries = |matrix| Matrix::new(matrix, keys, at.count, lanes);
            let by_queries = &mut gradients.queries[at.first * head_width..(at.first + at.count) * head_width];
            for (by, by_rows, of, rows) in [
                (&mut *by_values, keys, of_queries(weights), grad.tile(sample, head, at.first, at.count, sizes)),
                (&mut *by_keys, keys, of_queries(slopes), inputs.queries.tile(sample, head, at.first, at.count, sizes)),
                (
                    by_queries,
                    at.count,
                    of_queries(slopes).transposed(),
                    inputs.keys.tile(sample, head, first_key, keys, sizes),
                ),
            ] {
                multiply(
                    Output::new(by, by_rows, head_width, head_width),
                    of,
                    rows,
                    Write::Add,
                    (Threads::One, inputs.products),
                );
            }
        }
    }
    gradients
}

/// Data of a tile of queries for all tiles of keys, with one column per query.
struct QueryTile {
    at: Tile,
    queries: Vec<f32>,
    grad: Vec<f32>,
    log_sums: Vec<f32>,
    /// `Σ grad·out`, which the backward pass of softmax subtracts.
    along: Vec<f32>,
}

impl QueryTile {
    fn new(inputs: &Inputs<'_>, out: &[f32], log_sums: &[f32], grad: &Tokens<'_>, at: Tile) -> Self {
        let sizes = &inputs.sizes;
        let (lanes, heads) = (at.lanes(), sizes.heads);
        let mut tile = Self {
            at,
            queries: vec![0.0; sizes.head_width * lanes],
            grad: vec![0.0; sizes.head_width * lanes],
            log_sums: vec![f32::INFINITY; lanes],
            along: vec![0.0; lanes],
        };
        inputs.queries.transpose_into(&mut tile.queries, at, sizes.narrow_scale(), sizes);
        grad.transpose_into(&mut tile.grad, at, 1.0, sizes);
        for query in 0..at.count {
            let token = at.sample * sizes.queries + at.first + query;
            let place = token * sizes.width() + at.head * sizes.head_width;
            let (out, grad) = (&out[place..place + sizes.head_width], &grad.data[place..place + sizes.head_width]);
            tile.log_sums[query] = log_sums[token * heads + at.head];
            tile.along[query] = out.iter().zip(grad).map(|(a, b)| a * b).sum();
        }
        tile
    }

    /// The weights of some keys, and the gradients of their logits before scaling.
    fn weigh(&self, inputs: &Inputs<'_>, weights: &mut [f32], slopes: &mut [f32], first_key: usize, keys: usize) {
        let (at, sizes, lanes) = (self.at, &inputs.sizes, self.at.lanes());
        inputs.logits(weights, &self.queries, at, first_key, keys);
        multiply(
            Output::new(slopes, keys, lanes, lanes),
            inputs.values.tile(at.sample, at.head, first_key, keys, sizes),
            Matrix::new(&self.grad, sizes.head_width, lanes, lanes),
            Write::Set,
            (Threads::One, inputs.products),
        );
        simd::run(Weigh { weights, slopes, log_sums: &self.log_sums, along: &self.along, scale: sizes.narrow_scale() });
    }
}

struct Weigh<'a> {
    /// Logits, replaced by weights.
    weights: &'a mut [f32],
    /// Gradients of the weights, replaced by those of the dot products.
    slopes: &'a mut [f32],
    log_sums: &'a [f32],
    along: &'a [f32],
    scale: f32,
}

impl WithSimd for Weigh<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let exp = Exp::new(simd);
        let scale = simd.splat_f32s(self.scale);
        let (weights, _) = S::as_mut_simd_f32s(self.weights);
        let (slopes, _) = S::as_mut_simd_f32s(self.slopes);
        let (log_sums, _) = S::as_simd_f32s(self.log_sums);
        let (along, _) = S::as_simd_f32s(self.along);
        let vectors = log_sums.len();
        for (weights, slopes) in weights.chunks_exact_mut(vectors).zip(slopes.chunks_exact_mut(vectors)) {
            let columns = weights.iter_mut().zip(slopes).zip(log_sums.iter().zip(along));
            for ((weight, slope), (&log_sum, &along)) in columns {
                *weight = exp.of(simd, simd.sub_f32s(*weight, log_sum));
                let off = simd.sub_f32s(*slope, along);
                *slope = simd.mul_f32s(simd.mul_f32s(*weight, off), scale);
            }
        }
    }
}
