//! Polynomial exponentials and logarithms, bit-identical in every lane of every instruction set with fused
//! multiply-add.

use pulp::Simd;

/// `2^(−x)` for `x ≥ 0`, to 2 units in the last place down to `2^−20`, where it is clamped: far from denormals, and
/// below every alpha that is drawn, see [`crate::SMALLEST_MIN_ALPHA`].
pub(super) struct Exp2<S: Simd> {
    rounder: S::f32s,
    coefficients: [S::f32s; 5],
    one: S::f32s,
    limit: S::f32s,
    mantissa_bits: S::u32s,
}

/// 1.5·2²³: adding it rounds to an integer, in the low bits.
const ROUNDER: f32 = 12_582_912.0;

impl<S: Simd> Exp2<S> {
    #[inline(always)]
    pub(super) fn new(simd: S) -> Self {
        // Minimax of 2^(−x) on [−½, ½] to 9e-8; the constant term is 1.
        #[expect(clippy::approx_constant, reason = "the minimax coefficient is not ln 2")]
        const COEFFICIENTS: [f32; 5] = [-1.326_472_7e-3, 9.671_513e-3, -5.550_733_6e-2, 2.402_224_2e-1, -6.931_47e-1];
        Self {
            rounder: simd.splat_f32s(ROUNDER),
            coefficients: COEFFICIENTS.map(|value| simd.splat_f32s(value)),
            one: simd.splat_f32s(1.0),
            limit: simd.splat_f32s(20.0),
            mantissa_bits: simd.splat_u32s(23),
        }
    }

    #[inline(always)]
    pub(super) fn of_negative(&self, simd: S, x: S::f32s) -> S::f32s {
        let x = simd.min_f32s(x, self.limit);
        let shifted = simd.sub_f32s(self.rounder, x);
        let fraction = simd.add_f32s(x, simd.sub_f32s(shifted, self.rounder));
        let [c5, c4, c3, c2, c1] = self.coefficients;
        let value = simd.mul_add_e_f32s(c5, fraction, c4);
        let value = simd.mul_add_e_f32s(value, fraction, c3);
        let value = simd.mul_add_e_f32s(value, fraction, c2);
        let value = simd.mul_add_e_f32s(value, fraction, c1);
        let value = simd.mul_add_e_f32s(value, fraction, self.one);
        let scale = simd.wrapping_dyn_shl_u32s(simd.transmute_u32s_f32s(shifted), self.mantissa_bits);
        simd.transmute_f32s_u32s(simd.add_u32s(simd.transmute_u32s_f32s(value), scale))
    }
}

/// `e^x` to 2 units in the last place; 0 for results below f32's normal range, infinity above it, NaN for NaN.
#[inline(always)]
pub(super) fn exp<S: Simd>(simd: S, x: S::f32s) -> S::f32s {
    const LOG2_E: f32 = std::f32::consts::LOG2_E;
    // ln 2 in two parts; products of the first with small integers are exact.
    const LN_2: [f32; 2] = [-0.693_359_4, 2.121_944_4e-4];
    // Minimax on [−½ ln 2, ½ ln 2] to 2e-9; the constant term is 1.
    const COEFFICIENTS: [f32; 5] = [1.384_364_7e-3, 8.374_161e-3, 4.166_8e-2, 1.666_643_2e-1, 0.499_999_94];
    let splat = |value: f32| simd.splat_f32s(value);
    let (rounder, one) = (splat(ROUNDER), splat(1.0));
    let inside = simd.min_f32s(simd.max_f32s(x, splat(-87.0)), splat(88.0));
    let shifted = simd.mul_add_e_f32s(inside, splat(LOG2_E), rounder);
    let quotient = simd.sub_f32s(shifted, rounder);
    let remainder = simd.mul_add_e_f32s(quotient, splat(LN_2[0]), inside);
    let remainder = simd.mul_add_e_f32s(quotient, splat(LN_2[1]), remainder);
    let [c6, c5, c4, c3, c2] = COEFFICIENTS.map(splat);
    let value = simd.mul_add_e_f32s(c6, remainder, c5);
    let value = simd.mul_add_e_f32s(value, remainder, c4);
    let value = simd.mul_add_e_f32s(value, remainder, c3);
    let value = simd.mul_add_e_f32s(value, remainder, c2);
    let value = simd.mul_add_e_f32s(value, remainder, one);
    let value = simd.mul_add_e_f32s(value, remainder, one);
    let scale = simd.wrapping_dyn_shl_u32s(simd.transmute_u32s_f32s(shifted), simd.splat_u32s(23));
    let value = simd.transmute_f32s_u32s(simd.add_u32s(simd.transmute_u32s_f32s(value), scale));
    let value = simd.select_f32s(simd.less_than_f32s(x, splat(-87.0)), splat(0.0), value);
    let value = simd.select_f32s(simd.greater_than_f32s(x, splat(88.0)), splat(f32::INFINITY), value);
    simd.select_f32s(simd.equal_f32s(x, x), value, splat(f32::NAN))
}

/// `log₂ x` of positive normal numbers, to 2e-6 plus a unit in the last place.
#[inline(always)]
pub(super) fn log2<S: Simd>(simd: S, x: S::f32s) -> S::f32s {
    // Minimax on [1, 2].
    const COEFFICIENTS: [f32; 6] = [0.275_148_8, -1.266_918_4, 3.286_529_3, -5.341_99, 6.112_963, -3.040_040_5];
    let splat = |value: f32| simd.splat_f32s(value);
    let bits = simd.transmute_u32s_f32s(x);
    let exponent = simd.wrapping_dyn_shr_u32s(bits, simd.splat_u32s(23));
    // Converted to f32 as the low bits of 2²³ + exponent.
    let exponent = simd.transmute_f32s_u32s(simd.or_u32s(exponent, simd.splat_u32s(0x4b00_0000)));
    let exponent = simd.sub_f32s(exponent, splat(8_388_608.0 + 127.0));
    let mantissa = simd.and_u32s(bits, simd.splat_u32s(0x007f_ffff));
    let mantissa = simd.transmute_f32s_u32s(simd.or_u32s(mantissa, simd.splat_u32s(0x3f80_0000)));
    let mut value = splat(-0.025_691_09);
    for coefficient in COEFFICIENTS {
        value = simd.mul_add_e_f32s(value, mantissa, splat(coefficient));
    }
    simd.add_f32s(exponent, value)
}
