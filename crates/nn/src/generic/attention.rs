use std::ops::Range;

use burn::backend::Backend;
use burn::backend::tensor::FloatTensor;

use super::Array;
use crate::backend::{AttentionInputs, AttentionSizes};

/// Number of queries and of keys in a tile.
const TILE: usize = 1024;

/// Attention and the logarithm of each row's sum of exponentials, `[batch, queries, heads]`.
pub(crate) fn forward<B: Backend>(
    inputs: AttentionInputs<B>,
    sizes: AttentionSizes,
) -> (FloatTensor<B>, FloatTensor<B>) {
    let [queries, keys, values] = split(inputs, &sizes);
    let (mut outs, mut log_sums) = (Vec::new(), Vec::new());
    let (largest_finite, least) = queries.extremes();
    for first in (0..sizes.queries).step_by(TILE) {
        let count = TILE.min(sizes.queries - first);
        let tile = queries.clone().range(2, first..first + count);
        let per_query = [sizes.batch, sizes.heads, count, 1];
        let mut largest = queries.zeros_like(&per_query).plus(-largest_finite);
        let mut total = queries.zeros_like(&per_query);
        let mut sums = queries.zeros_like(&[sizes.batch, sizes.heads, count, sizes.head_width]);
        for (first_key, end) in key_tiles(&sizes) {
            let logits = logits(&tile, &keys, first_key..end, &sizes);
            let now = largest.clone().larger(logits.clone().max(3));
            let weights = (logits - now.clone()).exp();
            let factor = (largest - now.clone()).exp();
            total = total * factor.clone() + weights.clone().sum(3);
            sums = sums * factor + weights.matmul(values.clone().range(2, first_key..end));
            largest = now;
        }
        let total = total.at_least(least);
        outs.push(sums / total.clone());
        log_sums.push((largest + total.ln()).reshape(&[sizes.batch, sizes.heads, count]).swap(1, 2));
    }
    if outs.is_empty() {
        let nothing = |width| queries.zeros_like(&[sizes.batch, 0, width]).0;
        return (nothing(sizes.heads * sizes.head_width), nothing(sizes.heads));
    }
    (join_heads(Array::joined(outs, 2), &sizes).0, Array::joined(log_sums, 1).0)
}

/// The gradients of [`forward`]'s inputs, packed like the inputs.
pub(crate) fn backward<B: Backend>(
    inputs: AttentionInputs<B>,
    out: FloatTensor<B>,
    log_sums: FloatTensor<B>,
    grad: FloatTensor<B>,
    sizes: AttentionSizes,
) -> AttentionInputs<B> {
    let together = matches!(inputs, AttentionInputs::Together(_));
    let [queries, keys, values] = split(inputs, &sizes);
    let (out, grad) = (split_heads(Array(out), &sizes), split_heads(Array(grad), &sizes));
    let along = (out * grad.clone()).sum(3);
    let log_sums = Array::<B>(log_sums).swap(1, 2).reshape(&[sizes.batch, sizes.heads, sizes.queries, 1]);
    let per_key = [sizes.batch, sizes.heads, sizes.keys, sizes.head_width];
    let mut by_queries = queries.zeros_like(&[sizes.batch, sizes.heads, sizes.queries, sizes.head_width]);
    let (mut by_keys, mut by_values) = (queries.zeros_like(&per_key), queries.zeros_like(&per_key));
    for first in (0..sizes.queries).step_by(TILE) {
        let range = first..first + TILE.min(sizes.queries - first);
        let of = |array: &Array<B>| array.clone().range(2, range.clone());
        let (tile, grad) = (of(&queries), of(&grad));
        let mut by_tile = tile.clone().times(0.0);
        for (first_key, end) in key_tiles(&sizes) {
            let of_keys = |array: &Array<B>| array.clone().range(2, first_key..end);
            let logits = logits(&tile, &keys, first_key..end, &sizes);
            let weights = (logits - of(&log_sums)).exp();
            let slopes = grad.clone().matmul(of_keys(&values).transposed()) - of(&along);
            let slopes = (weights.clone() * slopes).times(sizes.scale());
            by_tile = by_tile + slopes.clone().matmul(of_keys(&keys));
            let add = |sum: Array<B>, more: Array<B>| {
                let before = of_keys(&sum);
                sum.with_range(2, first_key..end, before + more)
            };
            by_values = add(by_values, weights.transposed().matmul(grad.clone()));
            by_keys = add(by_keys, slopes.transposed().matmul(tile.clone()));
        }
        by_queries = by_queries.with_range(2, range, by_tile);
    }
    let [queries, keys, values] = [by_queries, by_keys, by_values].map(|part| join_heads(part, &sizes));
    if together {
        AttentionInputs::Together(Array::joined(vec![queries, keys, values], 2).0)
    } else {
        AttentionInputs::Apart { queries: queries.0, keys_values: Array::joined(vec![keys, values], 2).0 }
    }
}

fn key_tiles(sizes: &AttentionSizes) -> impl Iterator<Item = (usize, usize)> {
    let keys = sizes.keys;
    (0..keys).step_by(TILE).map(move |first| (first, keys.min(first + TILE)))
}

fn logits<B: Backend>(queries: &Array<B>, keys: &Array<B>, range: Range<usize>, sizes: &AttentionSizes) -> Array<B> {
    // Queries are scaled, not products, which are beyond the range of float16 sooner.
    queries.clone().times(sizes.scale()).matmul(keys.clone().range(2, range).transposed())
}

/// Queries, keys and values as `[batch, heads, tokens, head width]`.
fn split<B: Backend>(inputs: AttentionInputs<B>, sizes: &AttentionSizes) -> [Array<B>; 3] {
    let width = sizes.heads * sizes.head_width;
    let part =
        |packed: &Array<B>, index| split_heads(packed.clone().range(2, index * width..(index + 1) * width), sizes);
    match inputs {
        AttentionInputs::Together(packed) => {
            let packed = Array(packed);
            [0, 1, 2].map(|index| part(&packed, index))
        }
        AttentionInputs::Apart { queries, keys_values } => {
            let packed = Array(keys_values);
            [split_heads(Array(queries), sizes), part(&packed, 0), part(&packed, 1)]
        }
    }
}

fn split_heads<B: Backend>(array: Array<B>, sizes: &AttentionSizes) -> Array<B> {
    let tokens = array.dims()[1];
    array.reshape(&[sizes.batch, tokens, sizes.heads, sizes.head_width]).swap(1, 2)
}

fn join_heads<B: Backend>(array: Array<B>, sizes: &AttentionSizes) -> Array<B> {
    let tokens = array.dims()[2];
    array.swap(1, 2).reshape(&[sizes.batch, tokens, sizes.heads * sizes.head_width])
}
