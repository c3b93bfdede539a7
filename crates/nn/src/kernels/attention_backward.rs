use pulp::{Simd, WithSimd};
use rayon::prelude::*;

use super::attention::{Inputs, MATRIX_KEYS, QUERIES, Sizes, Tile, Tokens};
use super::matrix::{Factor, Matrix, Output, Write, multiply_factors};
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
    let mut tiles: Vec<_> = (0..sizes.queries)
        .step_by(QUERIES)
        .map(|first| Tile { sample, head, first, count: QUERIES.min(sizes.queries - first) })
        .map(|at| QueryTile::new(inputs, out, log_sums, &grad, at))
        .collect();
    let tile = sizes.key_tile(MATRIX_KEYS);
    let mut weights = vec![0.0; tile * QUERIES];
    let mut slopes = vec![0.0; tile * QUERIES];
    let keys_of = gradients.keys.chunks_mut(tile * head_width).zip(gradients.values.chunks_mut(tile * head_width));
    for ((first, count), (by_keys, by_values)) in inputs.key_tiles(MATRIX_KEYS).zip(keys_of) {
        let [rows, values] =
            [&inputs.keys, &inputs.values].map(|tokens| tokens.rows(sample, head, first, count, sizes));
        let columns = inputs.keys.columns(sample, head, first, count, sizes);
        let [rows_of, values_of] = [&rows, &values].map(|data| Matrix::new(data, count, head_width, head_width));
        let columns_of = Matrix::new(&columns, head_width, count, count);
        let [rows, columns, values] =
            [rows_of, columns_of, values_of].map(|matrix| Factor::left(matrix, inputs.precision));
        let keys = KeyTile { rows, columns, values };
        for query_tile in &mut tiles {
            let lanes = query_tile.at.lanes();
            let (weights, slopes) = (&mut weights[..count * lanes], &mut slopes[..count * lanes]);
            query_tile.weigh(inputs, &keys, weights, slopes);
            // Lanes beyond the tile's queries are not part of the sums.
            let of_queries = |matrix| Matrix::new(matrix, count, query_tile.at.count, lanes);
            for (by, of, rows) in [
                (&mut *by_values, of_queries(weights), &query_tile.grad_rows),
                (&mut *by_keys, of_queries(slopes), &query_tile.rows),
            ] {
                let of = Factor::left(of, inputs.precision);
                multiply_factors(Output::new(by, count, head_width, head_width), &of, rows, Write::Add);
            }
            let slopes = Factor::right(Matrix::new(slopes, count, lanes, lanes), inputs.precision);
            let out = Output::new(&mut query_tile.gradient, head_width, lanes, lanes);
            multiply_factors(out, &keys.columns, &slopes, Write::Add);
        }
    }
    for tile in &tiles {
        tile.write(&mut gradients.queries, head_width);
    }
    gradients
}

/// Keys and values for all tiles of queries.
struct KeyTile<'a> {
    rows: Factor<'a>,
    columns: Factor<'a>,
    values: Factor<'a>,
}

/// Data of a tile of queries for all tiles of keys.
struct QueryTile<'a> {
    at: Tile,
    rows: Factor<'a>,
    grad_rows: Factor<'a>,
    /// One column per query.
    queries: Vec<f32>,
    /// One column per query.
    grad: Vec<f32>,
    log_sums: Vec<f32>,
    /// `Σ grad·out`, which the backward pass of softmax subtracts.
    along: Vec<f32>,
    /// That of the queries, one column per query.
    gradient: Vec<f32>,
}

impl<'a> QueryTile<'a> {
    fn new(inputs: &Inputs<'a>, out: &[f32], log_sums: &[f32], grad: &Tokens<'a>, at: Tile) -> Self {
        let sizes = &inputs.sizes;
        let (lanes, heads) = (at.lanes(), sizes.heads);
        let rows =
            |of: &Tokens<'a>| Factor::right(of.tile(at.sample, at.head, at.first, at.count, sizes), inputs.precision);
        let mut tile = Self {
            at,
            rows: rows(&inputs.queries),
            grad_rows: rows(grad),
            queries: vec![0.0; sizes.head_width * lanes],
            grad: vec![0.0; sizes.head_width * lanes],
            log_sums: vec![f32::INFINITY; lanes],
            along: vec![0.0; lanes],
            gradient: vec![0.0; sizes.head_width * lanes],
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
    fn weigh(&self, inputs: &Inputs<'_>, keys: &KeyTile<'_>, weights: &mut [f32], slopes: &mut [f32]) {
        let (sizes, lanes) = (&inputs.sizes, self.at.lanes());
        let columns = |data| Factor::right(Matrix::new(data, sizes.head_width, lanes, lanes), inputs.precision);
        let count = slopes.len() / lanes;
        multiply_factors(Output::new(weights, count, lanes, lanes), &keys.rows, &columns(&self.queries), Write::Set);
        multiply_factors(Output::new(slopes, count, lanes, lanes), &keys.values, &columns(&self.grad), Write::Set);
        simd::run(Weigh { weights, slopes, log_sums: &self.log_sums, along: &self.along, scale: sizes.narrow_scale() });
    }

    /// Writes the gradients of the queries, which are in rows there.
    fn write(&self, out: &mut [f32], head_width: usize) {
        let rows = out[self.at.first * head_width..].chunks_exact_mut(head_width);
        for (query, row) in rows.take(self.at.count).enumerate() {
            for (slot, column) in row.iter_mut().zip(self.gradient.chunks_exact(self.at.lanes())) {
                *slot = column[query];
            }
        }
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
