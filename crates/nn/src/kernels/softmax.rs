use pulp::Simd;

use super::simd::Exp;

/// Turns one of `stride` columns of logits into weights relative to the largest logit so far, and adds them to the total.
///
/// Returns the factor by which sums relative to the previous largest logit shrink.
#[inline(always)]
pub(super) fn weigh<S: Simd>(
    simd: S,
    exp: &Exp<S>,
    logits: &mut [S::f32s],
    (stride, column): (usize, usize),
    (largest, total): (&mut S::f32s, &mut S::f32s),
) -> S::f32s {
    let (zero, none) = (simd.splat_f32s(0.0), simd.splat_f32s(f32::NEG_INFINITY));
    let before = *largest;
    // Several chains hide the latency of comparisons. They ignore NaN, which the exponentials propagate.
    let mut chains = [before; 4];
    let quads = logits.chunks_exact(4 * stride);
    for row in quads.remainder().chunks_exact(stride) {
        chains[0] = larger(simd, row[column], chains[0]);
    }
    for rows in quads {
        for (chain, row) in chains.iter_mut().zip(rows.chunks_exact(stride)) {
            *chain = larger(simd, row[column], *chain);
        }
    }
    let [a, b, c, d] = chains;
    let now = larger(simd, larger(simd, a, b), larger(simd, c, d));
    let reference = simd.select_f32s(simd.equal_f32s(now, none), zero, now);
    let mut added = zero;
    for row in logits.chunks_exact_mut(stride) {
        row[column] = exp.of(simd, simd.sub_f32s(row[column], reference));
        added = simd.add_f32s(added, row[column]);
    }
    let factor = exp.of(simd, simd.sub_f32s(before, reference));
    *total = simd.mul_add_e_f32s(*total, factor, added);
    *largest = now;
    factor
}

#[inline(always)]
fn larger<S: Simd>(simd: S, a: S::f32s, b: S::f32s) -> S::f32s {
    simd.select_f32s(simd.greater_than_f32s(a, b), a, b)
}
