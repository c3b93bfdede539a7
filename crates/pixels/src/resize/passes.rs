//! The two passes in portable Rust; `avx2` has the vectorised versions for x86-64.

use super::coefficients::{Coefficients, PRECISION_BITS};

/// Half of the last remaining bit, for rounding to nearest.
pub(super) const HALF: i32 = 1 << (PRECISION_BITS - 1);

/// Columns summed at a time, so that the sums stay in registers.
const BLOCK: usize = 32;

/// The instruction set of the passes; all levels give the same bits.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Level {
    /// Plain loops.
    Portable,
    /// 256-bit integer vectors.
    #[cfg(target_arch = "x86_64")]
    Avx2,
}

impl Level {
    /// All levels that this machine supports, the fastest first.
    pub(super) fn available() -> impl Iterator<Item = Self> {
        #[cfg(target_arch = "x86_64")]
        let wide = std::arch::is_x86_feature_detected!("avx2").then_some(Self::Avx2);
        #[cfg(not(target_arch = "x86_64"))]
        let wide = None;
        wide.into_iter().chain([Self::Portable])
    }

    pub(super) fn fastest() -> Self {
        Self::available().next().unwrap_or_else(|| unreachable!("the portable level is always available"))
    }
}

/// Resamples each row of `stride` bytes to `columns.len()` pixels.
pub(super) fn horizontal(level: Level, source: &[u8], stride: usize, columns: &Coefficients, target: &mut [u8]) {
    match level {
        Level::Portable => portable_horizontal(source, stride, columns, target),
        #[cfg(target_arch = "x86_64")]
        Level::Avx2 => super::avx2::horizontal(source, stride, columns, target),
    }
}

/// Resamples each column, from rows of `stride` bytes to `rows.len()` rows.
pub(super) fn vertical(level: Level, source: &[u8], stride: usize, rows: &Coefficients, target: &mut [u8]) {
    match level {
        Level::Portable => portable_vertical(source, stride, rows, target),
        #[cfg(target_arch = "x86_64")]
        Level::Avx2 => super::avx2::vertical(source, stride, rows, target),
    }
}

fn portable_horizontal(source: &[u8], stride: usize, columns: &Coefficients, target: &mut [u8]) {
    for (row, written) in source.chunks_exact(stride).zip(target.chunks_exact_mut(columns.len() * 3)) {
        for ((start, weights), out) in columns.iter().zip(written.as_chunks_mut::<3>().0) {
            let pixels = row[start * 3..].as_chunks::<3>().0;
            let mut sums = [HALF; 3];
            for (pixel, &weight) in pixels.iter().zip(weights) {
                for (sum, &sample) in sums.iter_mut().zip(pixel) {
                    *sum = sum.wrapping_add(i32::from(sample).wrapping_mul(weight));
                }
            }
            *out = sums.map(clipped);
        }
    }
}

fn portable_vertical(source: &[u8], stride: usize, rows: &Coefficients, target: &mut [u8]) {
    for ((start, weights), written) in rows.iter().zip(target.chunks_exact_mut(stride)) {
        let (blocks, rest) = written.as_chunks_mut::<BLOCK>();
        let rows_below = &source[start * stride..];
        let tail = blocks.len() * BLOCK;
        for (index, block) in blocks.iter_mut().enumerate() {
            sum_columns(rows_below, stride, index * BLOCK, weights, block);
        }
        sum_columns(rows_below, stride, tail, weights, rest);
    }
}

/// At most [`BLOCK`] columns of one target row, starting at `first`.
pub(super) fn sum_columns(source: &[u8], stride: usize, first: usize, weights: &[i32], written: &mut [u8]) {
    let mut sums = [HALF; BLOCK];
    for (row, &weight) in source.chunks_exact(stride).zip(weights) {
        for (sum, &sample) in sums.iter_mut().zip(&row[first..]) {
            *sum = sum.wrapping_add(i32::from(sample).wrapping_mul(weight));
        }
    }
    for (out, &sum) in written.iter_mut().zip(&sums) {
        *out = clipped(sum);
    }
}

#[expect(clippy::cast_sign_loss, reason = "clamped to a byte")]
fn clipped(sum: i32) -> u8 {
    (sum >> PRECISION_BITS).clamp(0, 255) as u8
}
