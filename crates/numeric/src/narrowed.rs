/// The nearest f32: the one rounding of what is computed in f64 to the precision of pixels, parameters and weights.
#[expect(clippy::cast_possible_truncation, reason = "the rounding is what it is for")]
#[inline]
pub const fn narrowed(value: f64) -> f32 {
    value as f32
}

/// The logit of an opacity in [0, 1]: `ln(p / (1 - p))`, infinite at 0 and 1, in the precision in which Gaussians store it.
pub fn logit(opacity: f64) -> f32 {
    narrowed((opacity / (1.0 - opacity)).ln())
}

/// The logistic function, the inverse of [`logit`].
pub fn sigmoid(logit: f32) -> f64 {
    1.0 / (1.0 + (-f64::from(logit)).exp())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Tolerance;

    #[test]
    fn rounds_to_the_nearest() {
        let step = f64::from(f32::EPSILON);
        let found = [1.0 + 0.4 * step, 1.0 + 0.6 * step].map(|value| narrowed(value).to_bits());
        assert_eq!(found, [1.0, 1.0 + f32::EPSILON].map(f32::to_bits));
    }

    #[test]
    fn logits_grow_with_the_opacity() {
        let found = [0.25, 0.5, 0.9].map(|opacity| f64::from(logit(opacity)));
        Tolerance::F32_ROUND_TRIP.assert(found, [(1.0f64 / 3.0).ln(), 0.0, 9.0f64.ln()], "logits");
        assert!(logit(0.0) == f32::NEG_INFINITY && logit(1.0) == f32::INFINITY);
    }
}
