use std::array;

use pulp::{Arch, Simd, WithSimd};

/// Runs an operation with the widest vector instructions of this processor.
#[inline]
pub(crate) fn run<O: WithSimd>(operation: O) -> O::Output {
    Arch::new().dispatch(operation)
}

/// `eˣ` for x ≤ 88 in every lane, within 2 ulp: 0 below −87.3, NaN for NaN.
#[derive(Clone, Copy)]
pub(crate) struct Exp<S: Simd> {
    lowest: S::f32s,
    log2_e: S::f32s,
    rounder: S::f32s,
    minus_ln_2: [S::f32s; 2],
    coefficients: [S::f32s; 7],
    mantissa_bits: S::u32s,
}

impl<S: Simd> Exp<S> {
    #[inline(always)]
    pub(crate) fn new(simd: S) -> Self {
        // Minimax on [−ln 2 / 2, ln 2 / 2], the two lowest powers being exact.
        const COEFFICIENTS: [f32; 7] =
            [1.381_453_1e-3, 8.368_713e-3, 4.166_839e-2, 1.666_652_1e-1, 4.999_999_4e-1, 1.0, 1.0];
        Self {
            lowest: simd.splat_f32s(-87.3),
            log2_e: simd.splat_f32s(std::f32::consts::LOG2_E),
            // 1.5·2²³ leaves the nearest integer in the low bits, 127 is the bias of the exponent.
            rounder: simd.splat_f32s(12_582_912.0 + 127.0),
            // In two parts; the product of the first with the exponent is exact.
            minus_ln_2: [-0.693_359_4, 2.121_944_4e-4].map(|part| simd.splat_f32s(part)),
            coefficients: COEFFICIENTS.map(|value| simd.splat_f32s(value)),
            mantissa_bits: simd.splat_u32s(23),
        }
    }

    #[inline(always)]
    pub(crate) fn of(&self, simd: S, x: S::f32s) -> S::f32s {
        let biased = simd.mul_add_e_f32s(x, self.log2_e, self.rounder);
        let whole = simd.sub_f32s(biased, self.rounder);
        let rest = simd.mul_add_e_f32s(whole, self.minus_ln_2[0], x);
        let rest = simd.mul_add_e_f32s(whole, self.minus_ln_2[1], rest);
        let [mut value, others @ ..] = self.coefficients;
        for next in others {
            value = simd.mul_add_e_f32s(value, rest, next);
        }
        // A product preserves NaN, which adding to the exponent's bits could lose.
        let power = simd.wrapping_dyn_shl_u32s(simd.transmute_u32s_f32s(biased), self.mantissa_bits);
        let value = simd.mul_f32s(value, simd.transmute_f32s_u32s(power));
        simd.select_f32s(simd.less_than_f32s(x, self.lowest), simd.splat_f32s(0.0), value)
    }
}

/// The standard normal distribution in every lane.
#[derive(Clone, Copy)]
pub(crate) struct Normal<S: Simd> {
    exp: Exp<S>,
    coefficients: [S::f32s; 8],
    slope: S::f32s,
}

impl<S: Simd> Normal<S> {
    #[inline(always)]
    pub(crate) fn new(simd: S) -> Self {
        // ½·erfcx(z) = t·p(t) with t = 1 / (1 + 0.327 591 1·z); minimax of the relative error, 1.1e-7, for z ≤ 9.6.
        const COEFFICIENTS: [f32; 8] = [
            -0.141_454_92,
            0.497_983_75,
            -0.407_994_78,
            0.455_010_8,
            0.024_586_314,
            0.206_115_19,
            0.180_699_2,
            0.185_054_56,
        ];
        Self {
            exp: Exp::new(simd),
            coefficients: COEFFICIENTS.map(|value| simd.splat_f32s(0.5 * value)),
            slope: simd.splat_f32s(0.327_591_1 * std::f32::consts::FRAC_1_SQRT_2),
        }
    }

    /// The probability of less than `x`, and `e^(−x²/2)`.
    #[inline(always)]
    pub(crate) fn cumulative(&self, simd: S, x: S::f32s) -> (S::f32s, S::f32s) {
        let (zero, one) = (simd.splat_f32s(0.0), simd.splat_f32s(1.0));
        let bell = self.exp.of(simd, simd.mul_f32s(simd.mul_f32s(x, x), simd.splat_f32s(-0.5)));
        let t = simd.div_f32s(one, simd.mul_add_e_f32s(simd.abs_f32s(x), self.slope, one));
        let [mut ratio, others @ ..] = self.coefficients;
        for next in others {
            ratio = simd.mul_add_e_f32s(ratio, t, next);
        }
        let tail = simd.mul_f32s(simd.mul_f32s(ratio, t), bell);
        (simd.select_f32s(simd.less_than_f32s(x, zero), tail, simd.sub_f32s(one, tail)), bell)
    }
}

/// The sum of a function over elements, in an order that depends only on their number.
///
/// Functions passed to this and to [`map`] must be bound to a name with `#[inline(always)]`: a function that is not inlined
/// is compiled without vector instructions.
#[inline(always)]
pub(crate) fn sum<S: Simd, const N: usize>(
    simd: S,
    slices: [&[f32]; N],
    vector: impl Fn([S::f32s; N]) -> S::f32s,
    scalar: impl Fn([f32; N]) -> f32,
) -> f32 {
    const CHAINS: usize = 4;
    let parts = slices.map(|slice| S::as_simd_f32s(slice));
    let whole = parts.map(|(vectors, _)| vectors.as_chunks::<CHAINS>());
    let mut sums = [simd.splat_f32s(0.0); CHAINS];
    let chunks = whole.iter().map(|(chunks, _)| chunks.len()).min().unwrap_or(0);
    for at in 0..chunks {
        for (chain, sum) in sums.iter_mut().enumerate() {
            *sum = simd.add_f32s(*sum, vector(array::from_fn(|i| whole[i].0[at][chain])));
        }
    }
    let rest = whole.iter().map(|(_, rest)| rest.len()).min().unwrap_or(0);
    for (at, sum) in sums.iter_mut().enumerate().take(rest) {
        *sum = simd.add_f32s(*sum, vector(array::from_fn(|i| whole[i].1[at])));
    }
    let [a, b, c, d] = sums;
    let mut total = simd.reduce_sum_f32s(simd.add_f32s(simd.add_f32s(a, b), simd.add_f32s(c, d)));
    let tail = parts.iter().map(|(_, tail)| tail.len()).min().unwrap_or(0);
    for at in 0..tail {
        total += scalar(array::from_fn(|i| parts[i].1[at]));
    }
    total
}

/// Replaces each element of `out` by a function of it and of the corresponding elements of `inputs`.
///
/// The last elements, too few for a vector, use the same instructions: an element's bits do not depend on its position.
#[inline(always)]
pub(crate) fn map<S: Simd, const N: usize>(
    simd: S,
    out: &mut [f32],
    inputs: [&[f32]; N],
    function: impl Fn(S::f32s, [S::f32s; N]) -> S::f32s,
) {
    let (vectors, tail) = S::as_mut_simd_f32s(out);
    let parts = inputs.map(|input| S::as_simd_f32s(input));
    let bodies = parts.map(|(body, _)| &body[..vectors.len()]);
    for (at, slot) in vectors.iter_mut().enumerate() {
        *slot = function(*slot, array::from_fn(|i| bodies[i][at]));
    }
    if !tail.is_empty() {
        let ends = parts.map(|(_, end)| simd.partial_load_f32s(end));
        let value = function(simd.partial_load_f32s(tail), ends);
        simd.partial_store_f32s(tail, value);
    }
}
