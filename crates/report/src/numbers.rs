//! Numbers as text, for tables, plots and pages: what is printed as 0 has no sign. Changes of a baseline's numbers are printed by
//! [`atsplat_drift::signed_change`].

/// The number with these decimals.
pub(crate) fn fixed(value: f64, decimals: usize) -> String {
    without_sign_of_zero(format!("{value:.decimals$}"))
}

/// The number with these decimals, and `+` before a positive one.
pub(crate) fn signed(value: f64, decimals: usize) -> String {
    without_sign_of_zero(format!("{value:+.decimals$}"))
}

/// A printed number with the minus sign of plots.
pub(crate) fn with_minus_sign(number: &str) -> String {
    number.replace('-', "−")
}

/// A number with three digits, or three decimals if it is below 1: `0.590`, `5.12`, `24.8`, `121`.
pub(crate) fn to_three_digits(value: f64) -> String {
    let decimals = match value.abs() {
        size if size >= 99.95 => 0,
        size if size >= 9.995 => 1,
        size if size >= 0.9995 => 2,
        _ => 3,
    };
    fixed(value, decimals)
}

/// A number with three significant digits, or more before its point: `0.00412`, `0.590`, `121`.
pub(crate) fn significant_digits(value: f64) -> String {
    const MAX_DECIMALS: usize = 9;
    let has_three = |decimals: &usize| value.abs() * 10f64.powf(*decimals as f64) >= 99.95;
    match (0..=MAX_DECIMALS).find(has_three) {
        Some(decimals) => fixed(value, decimals),
        None if value == 0.0 => "0".to_owned(),
        None => format!("{value:.2e}"),
    }
}

/// A number with three digits without trailing zeros, or three decimals: `0.59`, `2`.
pub(crate) fn three_digits(value: f64) -> String {
    let text = to_three_digits(value);
    if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.').to_owned() } else { text }
}

/// A count with at most three digits, in thousands or millions: `950`, `23K`, `5.9M`.
pub(crate) fn count_label(value: f64) -> String {
    match value {
        value if value >= 999_500.0 => format!("{}M", three_digits(value / 1e6)),
        value if value >= 999.5 => format!("{}K", three_digits(value / 1e3)),
        value => three_digits(value),
    }
}

fn without_sign_of_zero(text: String) -> String {
    match text.strip_prefix(['-', '+']) {
        Some(size) if size.chars().all(|letter| matches!(letter, '0' | '.')) => size.to_owned(),
        _ => text,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn three_digits_have_no_trailing_zeros() {
        let values = [0.0471, 0.59, 5.1249, 9.996, 24.772, 99.96, 120.96, 5898.2, 2.0, 80.04];
        assert_eq!(values.map(three_digits), ["0.047", "0.59", "5.12", "10", "24.8", "100", "121", "5898", "2", "80"]);
        let with_zeros = ["0.047", "0.590", "5.12", "10.0", "24.8", "100", "121", "5898", "2.00", "80.0"];
        assert_eq!(values.map(to_three_digits), with_zeros);
        assert_eq!([-5.1249, -0.0004].map(to_three_digits), ["-5.12", "0.000"]);
    }

    #[test]
    fn small_numbers_have_three_significant_digits() {
        let values = [0.0041, 0.59, 1.99, 12.34, 121.4, 0.0, 1.234e-12, -0.041_26];
        let texts = ["0.00410", "0.590", "1.99", "12.3", "121", "0", "1.23e-12", "-0.0413"];
        assert_eq!(values.map(significant_digits), texts);
    }

    #[test]
    fn plots_have_a_minus_sign() {
        assert_eq!([-0.5, 0.5, -0.004].map(|value| with_minus_sign(&signed(value, 2))), ["−0.50", "+0.50", "0.00"]);
    }

    #[test]
    fn counts_have_at_most_three_digits() {
        let counts = [950.0, 999.7, 23_040.0, 131_072.0, 999_700.0, 5_898_240.0];
        assert_eq!(counts.map(count_label), ["950", "1K", "23K", "131K", "1M", "5.9M"]);
    }

    #[test]
    fn what_is_printed_as_zero_has_no_sign() {
        let values = [-0.004, -0.006, 0.004, 0.006, -0.0, -10.0];
        assert_eq!(values.map(|value| signed(value, 2)), ["0.00", "-0.01", "0.00", "+0.01", "0.00", "-10.00"]);
        assert_eq!(values.map(|value| fixed(value, 2)), ["0.00", "-0.01", "0.00", "0.01", "0.00", "-10.00"]);
        assert_eq!([-0.4, 0.4, 0.6].map(|value| signed(value, 0)), ["0", "0", "+1"]);
    }
}
