//! Human-readable numbers; JSON keeps every digit.

use atsplat_metrics::{Scale, definition};

/// A score as papers print it, with its unit: `21.97 dB`, `0.812`.
pub(super) fn score(metric: &str, value: f64) -> String {
    let (decimals, unit) = style(metric);
    with_unit(format!("{value:.decimals$}"), unit)
}

/// A change of a score with its sign and unit: one decimal more than papers print, or two significant digits if it is smaller than
/// that. Unlike a difference in a table, a change of any size counts: `-0.125 dB`, `+3.6e-15 dB`.
pub fn change(metric: &str, value: f64) -> String {
    let (decimals, unit) = style(metric);
    with_unit(signed(value, decimals + 1), unit)
}

/// A range of changes.
pub(super) fn range(metric: &str, [low, high]: [f64; 2]) -> String {
    let (decimals, _) = style(metric);
    format!("{} to {}", signed(low, decimals + 1), change(metric, high))
}

/// An unsigned size, such as a limit, without trailing zeros.
pub(super) fn size(metric: &str, value: f64) -> String {
    let (_, unit) = style(metric);
    with_unit(short(value), unit)
}

/// A number without a unit.
pub(super) fn short(value: f64) -> String {
    let size = value.abs();
    if !(1e-4..1e6).contains(&size) {
        return if size > 0.0 && value.is_finite() { format!("{value:.1e}") } else { value.to_string() };
    }
    let decimals = decimals_of(size);
    let text = format!("{value:.decimals$}");
    let shown = if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.') } else { &text };
    shown.to_owned()
}

/// A signed change without a unit.
pub(super) fn signed(value: f64, decimals: usize) -> String {
    let size = value.abs();
    if value.is_nan() || size == 0.0 {
        return value.abs().to_string();
    }
    if size < 1e-6 || !value.is_finite() {
        return format!("{value:+.1e}");
    }
    let decimals = decimals.max(decimals_of(size));
    format!("{value:+.decimals$}")
}

/// Number of decimals that show two significant digits.
#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "between 0 and 8")]
fn decimals_of(size: f64) -> usize {
    (1.0 - size.log10().floor()).clamp(0.0, 8.0) as usize
}

fn style(metric: &str) -> (usize, &'static str) {
    let unit = definition(metric).map_or("", |definition| definition.unit);
    (Scale::of(metric).decimals(), unit)
}

fn with_unit(number: String, unit: &str) -> String {
    if unit.is_empty() { number } else { format!("{number} {unit}") }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn scores_are_formatted_as_in_papers() {
        assert_eq!(score("psnr", 21.969_999_999), "21.97 dB");
        assert_eq!(score("ssim", 0.811_999_7), "0.812");
        assert_eq!(score("lpips", 0.1), "0.100");
    }

    #[test]
    fn changes_show_significant_digits() {
        for (value, expected) in [
            (0.0, "0 dB"),
            (0.125, "+0.125 dB"),
            (-1.0, "-1.000 dB"),
            (-0.001_249, "-0.0012 dB"),
            (3.6e-15, "+3.6e-15 dB"),
            (f64::NAN, "NaN dB"),
            (f64::NEG_INFINITY, "-inf dB"),
        ] {
            assert_eq!(change("psnr", value), expected, "{value}");
        }
        assert_eq!(change("ssim", -0.03), "-0.0300");
        assert_eq!(range("psnr", [-0.125, 1.0]), "-0.125 to +1.000 dB");
        assert_eq!(range("ssim", [0.25, 0.5]), "+0.2500 to +0.5000");
    }

    #[test]
    fn sizes_have_no_trailing_zeros() {
        for (value, expected) in
            [(0.01, "0.01 dB"), (0.123_456, "0.12 dB"), (25.0, "25 dB"), (1.25, "1.2 dB"), (2.5e-7, "2.5e-7 dB")]
        {
            assert_eq!(size("psnr", value), expected, "{value}");
        }
        assert_eq!((short(0.0), short(100.0), short(f64::NAN)), ("0".to_owned(), "100".to_owned(), "NaN".to_owned()));
    }
}
