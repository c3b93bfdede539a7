//! Sums over samples in a fixed order, independent of the number of threads and the SIMD width.

#![expect(clippy::inline_always, reason = "what is not inlined into the dispatched function loses its instructions")]

use pulp::{Arch, Simd, WithSimd};
use rayon::prelude::*;

/// Number of parallel partial sums; a multiple of every SIMD width.
const LANES: usize = 16;
/// Samples per task.
const RUN: usize = 1 << 16;

/// The summed difference: `(a − b)²` or `|a − b|`, in f64.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Difference {
    Squared,
    Absolute,
}

/// Sum of differences of two slices of equal length.
pub(crate) fn sum_of_differences(a: &[f32], b: &[f32], difference: Difference) -> f64 {
    let arch = Arch::new();
    let runs = a.par_chunks(RUN).zip(b.par_chunks(RUN));
    let sums: Vec<f64> = runs.map(|(a, b)| arch.dispatch(Run { a, b, difference })).collect();
    sums.iter().sum()
}

/// The sum of a slice.
#[inline(always)]
pub(crate) fn sum(values: &[f64]) -> f64 {
    let (chunks, rest) = values.as_chunks::<LANES>();
    let mut lanes = [0.0; LANES];
    for chunk in chunks {
        for (lane, value) in lanes.iter_mut().zip(chunk) {
            *lane += value;
        }
    }
    lanes.iter().sum::<f64>() + rest.iter().sum::<f64>()
}

struct Run<'a> {
    a: &'a [f32],
    b: &'a [f32],
    difference: Difference,
}

impl WithSimd for Run<'_> {
    type Output = f64;

    #[inline(always)]
    fn with_simd<S: Simd>(self, _simd: S) -> f64 {
        match self.difference {
            Difference::Squared => self.accumulate(|d| d * d),
            Difference::Absolute => self.accumulate(f64::abs),
        }
    }
}

impl Run<'_> {
    #[inline(always)]
    fn accumulate(&self, term: impl Fn(f64) -> f64) -> f64 {
        let (a, rest_a) = self.a.as_chunks::<LANES>();
        let (b, rest_b) = self.b.as_chunks::<LANES>();
        let mut lanes = [0.0; LANES];
        for (a, b) in a.iter().zip(b) {
            for lane in 0..LANES {
                lanes[lane] += term(f64::from(a[lane]) - f64::from(b[lane]));
            }
        }
        let rest = rest_a.iter().zip(rest_b).map(|(a, b)| term(f64::from(*a) - f64::from(*b)));
        lanes.iter().sum::<f64>() + rest.sum::<f64>()
    }
}
