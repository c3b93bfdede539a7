use std::cmp::Ordering;

use burn::Tensor;
use burn::tensor::{Device, Int, TensorData};
use rayon::prelude::*;

/// What [`top_k`] chose.
#[derive(Clone, Debug)]
pub struct Selection {
    /// Numbers of the chosen elements, the largest first; `[batch, k]`.
    pub chosen: Tensor<2, Int>,
    /// Numbers of the others, ascending; `[batch, elements − k]`.
    pub rest: Tensor<2, Int>,
}

/// The `k` largest scores of each sample; `scores` is `[batch, elements]`.
///
/// Of equal scores (0 and −0 are equal) the one with the lower number comes first. NaN ranks below every number, −∞
/// included, so that a broken score is chosen only when nothing else is left. Rounding a ratio to `k` is the caller's.
/// No gradient flows: gather what was chosen with [`gather_rows`](crate::ops::gather_rows).
///
/// # Panics
/// When `k` is larger than the number of elements, or the scores cannot be read from their device.
pub fn top_k(scores: Tensor<2>, k: usize) -> Selection {
    let [batch, count] = scores.dims();
    assert!(k <= count, "{k} of {count} scores");
    let device = scores.device();
    let scores = scores.into_data_as::<f64>();
    let scores = scores.as_slice::<f64>().unwrap_or_default();
    let samples = scores.par_chunks(count.max(1)).map(|scores| {
        let mut order: Vec<usize> = (0..count).collect();
        order.sort_by(|&a, &b| rank(scores[a], scores[b]));
        let mut rest = order.split_off(k);
        rest.sort_unstable();
        (order, rest)
    });
    let (chosen, rest): (Vec<_>, Vec<_>) = samples.unzip();
    let numbers = |parts: Vec<Vec<usize>>, width| indices(parts.into_iter().flatten(), [batch, width], &device);
    Selection { chosen: numbers(chosen, k), rest: numbers(rest, count - k) }
}

/// `Less` where the first score comes before the second.
fn rank(a: f64, b: f64) -> Ordering {
    b.partial_cmp(&a).unwrap_or_else(|| a.is_nan().cmp(&b.is_nan()))
}

pub(super) fn indices<const D: usize>(
    numbers: impl Iterator<Item = usize>,
    shape: [usize; D],
    device: &Device,
) -> Tensor<D, Int> {
    let numbers: Vec<i64> = numbers.map(|number| number.cast_signed() as i64).collect();
    Tensor::from_data(TensorData::new(numbers, shape), device)
}
