//! The three SIMD loops of SSIM. None of them fuses multiplication and addition, so every instruction set gives bit-identical
//! results.

#![expect(clippy::inline_always, reason = "what is not inlined into the dispatched function loses its instructions")]

use pulp::Simd;

/// Number of windowed sums per pixel: of x, of y, of x² + y², of x y.
pub(super) const MOMENTS: usize = 4;

/// Computes a row's terms of the four sums.
#[inline(always)]
pub(super) fn moments<S: Simd>(_simd: S, x: &[f32], y: &[f32], mut out: [&mut [f64]; MOMENTS]) {
    let [xs, ys, squares, products] = &mut out;
    let slots = xs.iter_mut().zip(ys.iter_mut()).zip(squares.iter_mut().zip(products.iter_mut()));
    for ((x, y), ((sum_x, sum_y), (square, product))) in x.iter().zip(y).zip(slots) {
        let (x, y) = (f64::from(*x), f64::from(*y));
        (*sum_x, *sum_y, *square, *product) = (x, y, x * x + y * y, x * y);
    }
}

/// `Σ taps[k] · rows[k]` for symmetric taps, summed in the order centre, outermost pair, inwards.
#[inline(always)]
pub(super) fn weighted_sum<S: Simd, const TAPS: usize>(
    simd: S,
    taps: &[f64; TAPS],
    rows: [&[f64]; TAPS],
    out: &mut [f64],
) {
    let length = out.len();
    let mut vectors: [&[S::f64s]; TAPS] = [&[]; TAPS];
    let mut rests: [&[f64]; TAPS] = [&[]; TAPS];
    for ((row, vectors), rest) in rows.iter().zip(&mut vectors).zip(&mut rests) {
        (*vectors, *rest) = S::as_simd_f64s(&row[..length]);
    }
    let mut weights = [simd.splat_f64s(0.0); TAPS];
    for (weight, tap) in weights.iter_mut().zip(taps) {
        *weight = simd.splat_f64s(*tap);
    }
    let (out, out_rest) = S::as_mut_simd_f64s(out);
    let count = out.len();
    for vectors in &mut vectors {
        *vectors = &vectors[..count];
    }
    for (at, slot) in out.iter_mut().enumerate() {
        let mut sum = simd.mul_f64s(weights[TAPS / 2], vectors[TAPS / 2][at]);
        for tap in 0..TAPS / 2 {
            let both = simd.add_f64s(vectors[tap][at], vectors[TAPS - 1 - tap][at]);
            sum = simd.add_f64s(sum, simd.mul_f64s(weights[tap], both));
        }
        *slot = sum;
    }
    for (at, slot) in out_rest.iter_mut().enumerate() {
        let mut sum = taps[TAPS / 2] * rests[TAPS / 2][at];
        for tap in 0..TAPS / 2 {
            sum += taps[tap] * (rests[tap][at] + rests[TAPS - 1 - tap][at]);
        }
        *slot = sum;
    }
}

/// Constants of the similarity.
#[derive(Clone, Copy, Debug)]
pub(super) struct Constants {
    /// (0.01 · range)².
    pub(super) c1: f64,
    /// (0.03 · range)².
    pub(super) c2: f64,
    /// Factor on the population covariance.
    pub(super) covariance: f64,
}

/// `(2 μx μy + C1)(2 σxy + C2) / ((μx² + μy² + C1)(σx² + σy² + C2))`, of weighted sums.
#[inline(always)]
pub(super) fn similarity<S: Simd>(_simd: S, sums: [&[f64]; MOMENTS], constants: Constants, out: &mut [f64]) {
    let Constants { c1, c2, covariance } = constants;
    let [xs, ys, squares, products] = sums;
    let sums = xs.iter().zip(ys).zip(squares.iter().zip(products));
    for (((x, y), (square, product)), slot) in sums.zip(out) {
        let (means, mean_product) = (x * x + y * y, x * y);
        let variances = covariance * (square - means);
        let cross = covariance * (product - mean_product);
        *slot = ((mean_product + mean_product + c1) * (cross + cross + c2)) / ((means + c1) * (variances + c2));
    }
}
