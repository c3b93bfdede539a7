/// `decimals`, or as many as show that an interval does not contain 0, if both ends are on one side of it and one would print as 0.
pub fn decimals_of_interval(interval: Option<[f64; 2]>, decimals: usize) -> usize {
    const MAX_MORE: usize = 6;
    let nearest = match interval {
        Some([low, _]) if low > 0.0 => low,
        Some([_, high]) if high < 0.0 => high,
        _ => return decimals,
    };
    let is_zero =
        |decimals: usize| format!("{nearest:.decimals$}").chars().all(|letter| matches!(letter, '-' | '0' | '.'));
    (decimals..=decimals + MAX_MORE).find(|decimals| !is_zero(*decimals)).unwrap_or(decimals)
}

/// `decimals`, or two more than it takes to show a number that would print as 0 and is not.
pub fn decimals_of_small(value: f64, decimals: usize) -> usize {
    match decimals_of_interval(Some([value; 2]), decimals) {
        more if more > decimals => more + 2,
        _ => decimals,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

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
            assert_eq!(decimals_of_interval(interval, 2), expected, "{interval:?}");
        }
    }

    #[test]
    fn a_small_positive_number_does_not_print_as_zero() {
        for (value, expected) in
            [(0.2884, 3), (0.0006, 3), (0.000_48, 6), (4.87e-6, 8), (0.0, 3), (-4.87e-6, 8), (1e-300, 3)]
        {
            assert_eq!(decimals_of_small(value, 3), expected, "{value}");
        }
    }
}
