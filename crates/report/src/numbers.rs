//! Numbers as text: what is printed as 0 has no sign.

/// The number with these decimals.
pub(crate) fn fixed(value: f64, decimals: usize) -> String {
    without_sign_of_zero(format!("{value:.decimals$}"))
}

/// The number with these decimals, and `+` before a positive one.
pub(crate) fn signed(value: f64, decimals: usize) -> String {
    without_sign_of_zero(format!("{value:+.decimals$}"))
}

/// A positive number with at most three digits, without trailing zeros: `5.12`, `24.8`, `121`.
pub(crate) fn three_digits(value: f64) -> String {
    let decimals = if value >= 100.0 { 0 } else { usize::from(value < 10.0) + 1 };
    let text = format!("{value:.decimals$}");
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

/// `decimals`, or as many as show that an interval does not contain 0, if both ends are on one side of it and one would print as 0.
pub(crate) fn decimals_of(interval: Option<[f64; 2]>, decimals: usize) -> usize {
    const MOST_MORE: usize = 6;
    let nearest = match interval {
        Some([low, _]) if low > 0.0 => low,
        Some([_, high]) if high < 0.0 => high,
        _ => return decimals,
    };
    let is_zero = |decimals: usize| fixed(nearest, decimals).chars().all(|letter| matches!(letter, '0' | '.'));
    (decimals..=decimals + MOST_MORE).find(|decimals| !is_zero(*decimals)).unwrap_or(decimals)
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
        let texts = [5.1249, 24.772, 120.96, 5898.2, 2.0, 80.04].map(three_digits);
        assert_eq!(texts, ["5.12", "24.8", "121", "5898", "2", "80"]);
    }

    #[test]
    fn counts_have_at_most_three_digits() {
        let counts = [950.0, 999.7, 23_040.0, 131_072.0, 999_700.0, 5_898_240.0];
        assert_eq!(counts.map(count_label), ["950", "1K", "23K", "131K", "1M", "5.9M"]);
    }

    #[test]
    fn an_interval_beside_zero_does_not_print_as_zero() {
        for (interval, expected) in [
            (Some([-0.0028, -0.00076]), 3),
            (Some([0.000_04, 0.3]), 5),
            (Some([0.006, 0.3]), 2),
            (Some([-0.0028, 0.00076]), 2),
            (Some([-0.0028, 0.0]), 2),
            (Some([1e-300, 0.3]), 2),
            (None, 2),
        ] {
            assert_eq!(decimals_of(interval, 2), expected, "{interval:?}");
        }
    }

    #[test]
    fn what_is_printed_as_zero_has_no_sign() {
        let values = [-0.004, -0.006, 0.004, 0.006, -0.0, -10.0];
        assert_eq!(values.map(|value| signed(value, 2)), ["0.00", "-0.01", "0.00", "+0.01", "0.00", "-10.00"]);
        assert_eq!(values.map(|value| fixed(value, 2)), ["0.00", "-0.01", "0.00", "0.01", "0.00", "-10.00"]);
        assert_eq!([-0.4, 0.4, 0.6].map(|value| signed(value, 0)), ["0", "0", "+1"]);
    }
}
