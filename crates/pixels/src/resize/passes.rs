//! The two passes, in portable Rust; `avx2` holds the same sums for x86-64.

use super::coefficients::{Coefficients, PRECISION_BITS};

/// Half of the last bit that stays: rounds to nearest.
pub(super) const HALF: i32 = 1 << (PRECISION_BITS - 1);

/// How many columns are summed at a time, so that the sums stay in registers.
const BLOCK: usize = 32;

/// Which instructions the passes run on; every level gives the same bits.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Level {
    /// Whatever the compiler makes of plain loops.
    Portable,
    /// 256-bit integer vectors.
    #[cfg(target_arch = "x86_64")]
    Avx2,
}

impl Level {
    /// All levels that this machine runs, the fastest first.
    pub(super) fn available() -> impl Iterator<Item = Self> {
        #[cfg(target_arch = "x86_64")]
        let wide = std::arch::is_x86_feature_detected!("avx2").then_some(Self::Avx2);
        #[cfg(not(target_arch = "x86_64"))]
        let wide = None;
        wide.into_iter().chain([Self::Portable])
    }

    pub(super) fn fastest() -> Self {
        Self::available().next().unwrap_or(Self::Portable)
    }
}

/// Every row by itself: rows of `stride` bytes into `columns.len()` pixels each.
pub(super) fn horizontal(level: Level, source: &[u8], stride: usize, columns: &Coefficients, target: &mut [u8]) {
    match level {
        Level::Portable => portable_horizontal(source, stride, columns, target),
        #[cfg(target_arch = "x86_64")]
        Level::Avx2 => super::avx2::horizontal(source, stride, columns, target),
    }
}

/// Every column by itself: rows of `stride` bytes into `rows.len()` rows.
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
            let pixels = row.get(start * 3..).unwrap_or_default().as_chunks::<3>().0;
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
        let seen = source.get(start * stride..).unwrap_or_default();
        let tail = blocks.len() * BLOCK;
        for (index, block) in blocks.iter_mut().enumerate() {
            sum_columns(seen, stride, index * BLOCK, weights, block);
        }
        sum_columns(seen, stride, tail, weights, rest);
    }
}

/// One target row's columns from `first` on, at most [`BLOCK`] of them.
pub(super) fn sum_columns(seen: &[u8], stride: usize, first: usize, weights: &[i32], written: &mut [u8]) {
    let mut sums = [HALF; BLOCK];
    for (row, &weight) in seen.chunks_exact(stride).zip(weights) {
        let samples = row.get(first..).unwrap_or_default();
        for (sum, &sample) in sums.iter_mut().zip(samples) {
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
