use std::fmt;

use crate::Extremes as _;

/// The allowed difference of two floats: `|actual − expected| ≤ absolute + relative · |expected|`, as in NumPy's
/// `isclose`.
///
/// NaN is never close, not even to NaN, and an infinity is close only to itself, so that comparisons fail for invalid
/// values.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Tolerance {
    /// Allowed absolute difference; ≥ 0.
    pub absolute: f64,
    /// Allowed difference as a fraction of the expected value; ≥ 0.
    pub relative: f64,
}

impl Tolerance {
    /// Equality (with `-0.0 == 0.0`).
    pub const EXACT: Self = Self::absolute(0.0);
    /// Rounding errors of a few dozen f64 operations on values of order one.
    pub const F64: Self = Self::absolute(1e-12);
    /// Rounding errors of a rotation with rows normalised in f64.
    pub const ORTHONORMAL: Self = Self::absolute(1e-14);
    /// Rounding errors of a pose or intrinsic stored as f32 or with nine decimals.
    pub const F32_ROUND_TRIP: Self = Self::absolute(1e-6);
    /// The defaults of `numpy.allclose`, which DepthSplat's loader applies to `det(R)` (depthsplat
    /// `src/dataset/dataset_dl3dv.py:211-279`).
    pub const NUMPY_ALLCLOSE: Self = Self { absolute: 1e-8, relative: 1e-5 };

    /// A tolerance of `absolute`.
    pub const fn absolute(absolute: f64) -> Self {
        Self { absolute, relative: 0.0 }
    }

    /// A tolerance of `relative · |expected|`.
    pub const fn relative(relative: f64) -> Self {
        Self { absolute: 0.0, relative }
    }

    /// A tolerance of `share` times the largest absolute value, such as that of a gradient's numbers, most of which are small by
    /// cancellation. With NaN among the values, it accepts only equal numbers.
    pub fn of_largest(share: f64, values: impl IntoIterator<Item = f64>) -> Self {
        Self::absolute(share * values.into_iter().fold(0.0, |largest: f64, value| largest.maximum_of(value.abs())))
    }

    /// Whether `actual` is within this tolerance of `expected`.
    #[expect(clippy::float_cmp, reason = "an infinity is close only to itself")]
    pub fn accepts(self, actual: f64, expected: f64) -> bool {
        if actual == expected {
            return true;
        }
        let distance = (actual - expected).abs();
        distance.is_finite() && distance <= self.absolute + self.relative * expected.abs()
    }

    /// Compares two sequences element by element.
    ///
    /// # Errors
    /// The first element outside the tolerance, or missing in one of the sequences.
    pub fn check<A, E>(self, actual: A, expected: E) -> Result<(), Mismatch>
    where
        A: IntoIterator<Item = f64>,
        E: IntoIterator<Item = f64>,
    {
        let mut actual = actual.into_iter();
        let mut expected = expected.into_iter();
        let mut index = 0;
        loop {
            match (actual.next(), expected.next()) {
                (None, None) => return Ok(()),
                (Some(a), Some(e)) if self.accepts(a, e) => index += 1,
                (a, e) => return Err(Mismatch { index, actual: a, expected: e, tolerance: self }),
            }
        }
    }

    /// Compares two sequences and panics with the first mismatch; for tests.
    ///
    /// # Panics
    /// If [`Tolerance::check`] fails.
    #[track_caller]
    #[expect(clippy::panic, reason = "an assertion")]
    pub fn assert<A, E>(self, actual: A, expected: E, what: &str)
    where
        A: IntoIterator<Item = f64>,
        E: IntoIterator<Item = f64>,
    {
        if let Err(mismatch) = self.check(actual, expected) {
            panic!("{what}: {mismatch}");
        }
    }
}

/// The first difference of two sequences that exceeds a [`Tolerance`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Mismatch {
    /// Position of the element, from 0.
    pub index: usize,
    /// The element found; `None` past the end.
    pub actual: Option<f64>,
    /// The element expected; `None` past the end.
    pub expected: Option<f64>,
    /// The tolerance that was applied.
    pub tolerance: Tolerance,
}

impl fmt::Display for Mismatch {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let show = |value: Option<f64>| value.map_or_else(|| "nothing".to_owned(), |v| format!("{v:e}"));
        write!(
            f,
            "element {}: expected {}, found {} (absolute {:e}, relative {:e})",
            self.index,
            show(self.expected),
            show(self.actual),
            self.tolerance.absolute,
            self.tolerance.relative
        )
    }
}

impl std::error::Error for Mismatch {}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nan_is_never_close() {
        let loose = Tolerance::absolute(f64::MAX);
        assert!(!loose.accepts(f64::NAN, f64::NAN), "NaN against itself");
        assert!(!loose.accepts(f64::NAN, 0.0), "NaN against a number");
        assert!(!loose.accepts(0.0, f64::NAN), "a number against NaN");
    }

    #[test]
    fn infinity_is_close_only_to_itself() {
        assert!(Tolerance::EXACT.accepts(f64::INFINITY, f64::INFINITY));
        assert!(!Tolerance::relative(1.0).accepts(f64::INFINITY, 1.0));
        assert!(!Tolerance::relative(1.0).accepts(1.0, f64::INFINITY), "an infinite tolerance accepts nothing else");
    }

    #[test]
    fn absolute_and_relative_parts_add_up() {
        let tolerance = Tolerance { absolute: 0.5, relative: 0.1 };
        assert!(tolerance.accepts(11.5, 10.0));
        assert!(!tolerance.accepts(11.6, 10.0));
    }

    #[test]
    fn a_share_of_the_largest_is_of_its_absolute_value() {
        assert_eq!(Tolerance::of_largest(0.5, [1.0, -20.0, 3.0]), Tolerance::absolute(10.0));
        assert_eq!(Tolerance::of_largest(0.5, []), Tolerance::EXACT);
        let of_nan = Tolerance::of_largest(0.5, [20.0, f64::NAN, 30.0]);
        assert!(of_nan.accepts(1.0, 1.0) && !of_nan.accepts(1.0, 1.5));
    }

    #[test]
    fn check_reports_the_first_mismatch_and_missing_elements() {
        let mismatch = Tolerance::EXACT.check([1.0, 2.0], [1.0, 3.0]).unwrap_err();
        assert_eq!(mismatch.to_string(), "element 1: expected 3e0, found 2e0 (absolute 0e0, relative 0e0)");
        let short = Tolerance::EXACT.check([1.0], [1.0, 3.0]).unwrap_err();
        assert_eq!((short.index, short.actual), (1, None));
    }
}
