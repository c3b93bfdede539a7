/// Maximum and minimum of two floats that propagate NaN, like IEEE 754-2019 `maximum` and `minimum`.
///
/// `f64::max(NAN, 1.0)` is `1.0`, which would turn an invalid pixel or pose into a plausible number.
pub trait Extremes: Copy + PartialOrd {
    /// The larger of the two; NaN if either is NaN.
    #[must_use]
    fn maximum_of(self, other: Self) -> Self;
    /// The smaller of the two; NaN if either is NaN.
    #[must_use]
    fn minimum_of(self, other: Self) -> Self;
}

macro_rules! impl_extremes {
    ($($float:ty),*) => {$(
        impl Extremes for $float {
            #[inline]
            fn maximum_of(self, other: Self) -> Self {
                if self.is_nan() || self > other { self } else { other }
            }

            #[inline]
            fn minimum_of(self, other: Self) -> Self {
                if self.is_nan() || self < other { self } else { other }
            }
        }
    )*};
}

impl_extremes!(f32, f64);

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Tolerance;

    #[test]
    fn nan_propagates_from_both_sides() {
        assert!(f64::NAN.maximum_of(1.0).is_nan(), "NaN on the left");
        assert!(1.0f64.maximum_of(f64::NAN).is_nan(), "NaN on the right");
        assert!(f32::NAN.minimum_of(1.0).is_nan(), "NaN on the left");
        assert!(1.0f32.minimum_of(f32::NAN).is_nan(), "NaN on the right");
    }

    #[test]
    fn ordinary_values_and_infinities() {
        Tolerance::EXACT.assert([1.0f64.maximum_of(2.0), 1.0f64.minimum_of(2.0)], [2.0, 1.0], "of two");
        let against_infinity = [f64::INFINITY.minimum_of(3.0), f64::NEG_INFINITY.maximum_of(3.0)];
        Tolerance::EXACT.assert(against_infinity, [3.0, 3.0], "against infinity");
    }
}
