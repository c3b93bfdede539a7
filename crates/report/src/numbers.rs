//! Numbers as text: what is printed as 0 has no sign.

/// The number with these decimals.
pub(crate) fn fixed(value: f64, decimals: usize) -> String {
    without_sign_of_zero(format!("{value:.decimals$}"))
}

/// The number with these decimals, and `+` before a positive one.
pub(crate) fn signed(value: f64, decimals: usize) -> String {
    without_sign_of_zero(format!("{value:+.decimals$}"))
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
    fn what_is_printed_as_zero_has_no_sign() {
        let values = [-0.004, -0.006, 0.004, 0.006, -0.0, -10.0];
        assert_eq!(values.map(|value| signed(value, 2)), ["0.00", "-0.01", "0.00", "+0.01", "0.00", "-10.00"]);
        assert_eq!(values.map(|value| fixed(value, 2)), ["0.00", "-0.01", "0.00", "0.01", "0.00", "-10.00"]);
        assert_eq!([-0.4, 0.4, 0.6].map(|value| signed(value, 0)), ["0", "0", "+1"]);
    }
}
