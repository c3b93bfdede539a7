use rayon::prelude::*;

use super::columns;

/// Sizes of a gather: in each of `batch` samples, `picks · neighbours` rows of `width` elements are read from `rows`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Sizes {
    pub(crate) batch: usize,
    pub(crate) rows: usize,
    pub(crate) picks: usize,
    pub(crate) neighbours: usize,
    pub(crate) width: usize,
}

/// Copies rows: `[batch, rows, width]` to `[batch, picks, width]`; one neighbour each.
pub(crate) fn rows(x: &[f32], indices: &[usize], sizes: Sizes) -> Vec<f32> {
    let Sizes { batch, rows, picks, width, .. } = sizes;
    let mut out = vec![0.0; batch * picks * width];
    if out.is_empty() {
        return out;
    }
    out.par_chunks_mut(width).zip(indices).enumerate().for_each(|(pick, (out, &index))| {
        let from = (pick / picks * rows + index) * width;
        out.copy_from_slice(&x[from..from + width]);
    });
    out
}

/// The gradient of [`rows`]: sums over the picks in their order.
pub(crate) fn rows_backward(grad: &[f32], indices: &[usize], sizes: Sizes) -> Vec<f32> {
    let Sizes { batch, rows, picks, width, .. } = sizes;
    let mut out = vec![0.0; batch * rows * width];
    if out.is_empty() || picks == 0 {
        return out;
    }
    let samples = grad.par_chunks(picks * width).zip(indices.par_chunks(picks));
    out.par_chunks_mut(rows * width).zip(samples).for_each(|(out, (grad, indices))| {
        for (grad, &index) in grad.chunks_exact(width).zip(indices) {
            columns::add(&mut out[index * width..(index + 1) * width], grad);
        }
    });
    out
}

/// The maximum of each element over the neighbours, and the row of each maximum: `[batch, rows, width]` to
/// `[batch, picks, width]`. Ties go to the first neighbour, and NaN wins over everything. 0 without neighbours.
pub(crate) fn max(x: &[f32], indices: &[usize], sizes: Sizes) -> (Vec<f32>, Vec<i64>) {
    let Sizes { batch, rows, picks, neighbours, width } = sizes;
    let mut out = vec![0.0; batch * picks * width];
    let mut winners = vec![0; out.len()];
    if out.is_empty() || neighbours == 0 {
        return (out, winners);
    }
    let slots = out.par_chunks_mut(width).zip(winners.par_chunks_mut(width));
    slots.zip(indices.par_chunks(neighbours)).enumerate().for_each(|(pick, ((out, winners), indices))| {
        let sample = &x[pick / picks * rows * width..][..rows * width];
        out.fill(f32::NEG_INFINITY);
        winners.fill(indices[0].cast_signed() as i64);
        for &index in indices {
            let row = &sample[index * width..][..width];
            let number = index.cast_signed() as i64;
            for ((out, winner), &value) in out.iter_mut().zip(winners.iter_mut()).zip(row) {
                let wins = value > *out || (value.is_nan() && !out.is_nan());
                *out = if wins { value } else { *out };
                *winner = if wins { number } else { *winner };
            }
        }
    });
    (out, winners)
}

/// The gradient of [`max`]: each element's goes to the row of the maximum.
#[expect(clippy::expect_used, reason = "winners are row indices")]
pub(crate) fn max_backward(grad: &[f32], winners: &[i64], sizes: Sizes) -> Vec<f32> {
    let Sizes { batch, rows, picks, neighbours, width } = sizes;
    let mut out = vec![0.0; batch * rows * width];
    if out.is_empty() || picks == 0 || neighbours == 0 {
        return out;
    }
    let samples = grad.par_chunks(picks * width).zip(winners.par_chunks(picks * width));
    out.par_chunks_mut(rows * width).zip(samples).for_each(|(out, (grad, winners))| {
        for (grad, winners) in grad.chunks_exact(width).zip(winners.chunks_exact(width)) {
            for (column, (&grad, &winner)) in grad.iter().zip(winners).enumerate() {
                let row = usize::try_from(winner).expect("a row index");
                out[row * width + column] += grad;
            }
        }
    });
    out
}
