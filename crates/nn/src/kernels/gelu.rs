use pulp::{Simd, WithSimd};
use rayon::prelude::*;

use super::simd::{self, Normal};

/// Elements per task.
const CHUNK: usize = 1 << 13;

/// `x·Φ(x)`.
pub(crate) fn forward(x: &[f32]) -> Vec<f32> {
    let mut out = vec![0.0; x.len()];
    out.par_chunks_mut(CHUNK).zip(x.par_chunks(CHUNK)).for_each(|(out, x)| simd::run(Forward { out, x }));
    out
}

/// The gradient of `x`: `grad·(Φ(x) + x·φ(x))`.
pub(crate) fn backward(x: &[f32], grad: &[f32]) -> Vec<f32> {
    let mut out = vec![0.0; x.len()];
    let chunks = out.par_chunks_mut(CHUNK).zip(x.par_chunks(CHUNK)).zip(grad.par_chunks(CHUNK));
    chunks.for_each(|((out, x), grad)| simd::run(Backward { out, x, grad }));
    out
}

struct Forward<'a> {
    out: &'a mut [f32],
    x: &'a [f32],
}

impl WithSimd for Forward<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let normal = Normal::new(simd);
        let activate = {
            #[inline(always)]
            |_, [x]: [S::f32s; 1]| {
                let (probability, _) = normal.cumulative(simd, x);
                times(simd, x, probability)
            }
        };
        simd::map(simd, self.out, [self.x], activate);
    }
}

struct Backward<'a> {
    out: &'a mut [f32],
    x: &'a [f32],
    grad: &'a [f32],
}

impl WithSimd for Backward<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        const INVERSE_SQRT_TAU: f32 = 0.398_942_3;
        let normal = Normal::new(simd);
        let peak = simd.splat_f32s(INVERSE_SQRT_TAU);
        let differentiate = {
            #[inline(always)]
            |_, [x, grad]: [S::f32s; 2]| {
                let (probability, bell) = normal.cumulative(simd, x);
                let slope = simd.add_f32s(probability, times(simd, x, simd.mul_f32s(peak, bell)));
                simd.mul_f32s(grad, slope)
            }
        };
        simd::map(simd, self.out, [self.x, self.grad], differentiate);
    }
}

/// `x·weight`, but 0 for weight 0, so that the underflowed tail times infinity is 0.
#[inline(always)]
fn times<S: Simd>(simd: S, x: S::f32s, weight: S::f32s) -> S::f32s {
    let zero = simd.splat_f32s(0.0);
    simd.select_f32s(simd.equal_f32s(weight, zero), zero, simd.mul_f32s(x, weight))
}
