use std::cmp::Ordering;

use burn::Tensor;
use burn::tensor::{Device, Int, TensorData};
use rayon::prelude::*;

/// Result of [`top_k`].
#[derive(Clone, Debug)]
pub struct Selection {
    /// Indices of the selected elements, the largest first; `[batch, k]`.
    pub chosen: Tensor<2, Int>,
    /// Indices of the others, ascending; `[batch, elements − k]`.
    pub rest: Tensor<2, Int>,
}

/// The `k` largest scores of each sample; `scores` is `[batch, elements]`.
///
/// Ties go to the lower index (0 and −0 are equal). NaN ranks below every number including −∞, so that it is selected last.
/// There is no gradient: gather the selected elements with [`gather_rows`](crate::ops::gather_rows).
///
/// # Panics
/// If `k` is larger than the number of elements, or the scores cannot be read from their device.
#[expect(clippy::expect_used, reason = "a tensor's data has the element type that it was converted to")]
pub fn top_k(scores: Tensor<2>, k: usize) -> Selection {
    let [batch, count] = scores.dims();
    assert!(k <= count, "expected at least {k} scores, found {count}");
    let device = scores.device();
    let scores: Vec<f64> = scores.into_data_as::<f64>().try_to_vec().expect("data converted to f64");
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

/// `Less` if the first score comes before the second.
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
