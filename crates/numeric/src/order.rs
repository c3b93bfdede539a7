/// The arithmetic mean; NaN if any value is NaN. `None` without values.
pub fn mean(values: impl IntoIterator<Item = f64>) -> Option<f64> {
    let (sum, count) = values.into_iter().fold((0.0, 0u64), |(sum, count), value| (sum + value, count + 1));
    (count > 0).then(|| sum / count as f64)
}

/// The median as in `numpy.median`: the mean of the two middle values for an even count, NaN if any value is NaN. `None`
/// without values.
pub fn median(values: impl IntoIterator<Item = f64>) -> Option<f64> {
    let mut sorted: Vec<f64> = values.into_iter().collect();
    if sorted.iter().any(|value| value.is_nan()) {
        return Some(f64::NAN);
    }
    sorted.sort_by(f64::total_cmp);
    let upper = *sorted.get(sorted.len() / 2)?;
    let lower = *sorted.get((sorted.len() - 1) / 2)?;
    Some(f64::midpoint(lower, upper))
}

/// The `share` quantile (0 to 1) of ascending values with linear interpolation, the default of `numpy.quantile`. `None`
/// without values.
pub fn quantile(sorted: &[f64], share: f64) -> Option<f64> {
    let position = share * sorted.len().checked_sub(1)? as f64;
    let below = position.floor();
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a position in the slice")]
    let at = below as usize;
    let low = *sorted.get(at)?;
    let high = sorted.get(at + 1).copied().unwrap_or(low);
    Some(low + (high - low) * (position - below))
}

/// The `share` quantile (0 to 1) without interpolation: of the values in ascending order, the one whose place between the first (0)
/// and the last (1) is nearest to the share, as with `method="nearest"` of `numpy.quantile`, but the greater of two equally near ones.
/// NaN if any value is NaN. Reorders the values; `None` without any.
#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a share of a length is within it")]
pub fn nearest_quantile(values: &mut [f64], share: f64) -> Option<f64> {
    let last = values.len().checked_sub(1)?;
    if values.iter().any(|value| value.is_nan()) {
        return Some(f64::NAN);
    }
    let at = (share.clamp(0.0, 1.0) * last as f64).round() as usize;
    Some(*values.select_nth_unstable_by(at.min(last), f64::total_cmp).1)
}

/// Each value once, where it is first.
pub fn distinct<T: PartialEq>(values: impl IntoIterator<Item = T>) -> Vec<T> {
    let mut found = Vec::new();
    for value in values {
        if !found.contains(&value) {
            found.push(value);
        }
    }
    found
}

/// The values of each key, with the keys where they are first.
pub fn grouped<K: PartialEq, V>(pairs: impl IntoIterator<Item = (K, V)>) -> Vec<(K, Vec<V>)> {
    let mut groups: Vec<(K, Vec<V>)> = Vec::new();
    for (key, value) in pairs {
        match groups.iter_mut().find(|(known, _)| *known == key) {
            Some((_, values)) => values.push(value),
            None => groups.push((key, vec![value])),
        }
    }
    groups
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn means_of_none_and_several() {
        assert_eq!(mean([]), None);
        assert_eq!(mean([1.0, 2.0, 6.0]), Some(3.0));
        assert!(mean([1.0, f64::NAN]).is_some_and(f64::is_nan));
    }

    #[test]
    fn medians_of_odd_and_even_counts() {
        assert_eq!(median([]), None);
        assert_eq!(median([3.0, 1.0, 2.0]), Some(2.0));
        assert_eq!(median([4.0, 1.0, 2.0, 3.5]), Some(2.75));
        assert_eq!(median([f64::INFINITY, f64::INFINITY]), Some(f64::INFINITY));
        assert!(median([1.0, f64::NAN]).is_some_and(f64::is_nan));
    }

    #[test]
    fn quantiles_are_interpolated() {
        let sorted = [0.0, 1.0, 4.0, 10.0];
        assert_eq!(quantile(&sorted, 0.0), Some(0.0));
        assert_eq!(quantile(&sorted, 0.5), Some(2.5));
        assert_eq!(quantile(&sorted, 0.75), Some(5.5));
        assert_eq!(quantile(&sorted, 1.0), Some(10.0));
        assert_eq!(quantile(&[], 0.5), None);
    }

    #[test]
    fn quantiles_without_interpolation_are_among_the_values() {
        let of = |share| nearest_quantile(&mut [10.0, 0.0, 4.0, 1.0], share);
        assert_eq!([0.0, 0.16, 0.17, 0.5, 0.83, 0.84, 1.0].map(of), [0.0, 0.0, 1.0, 4.0, 4.0, 10.0, 10.0].map(Some));
        assert_eq!((of(-0.5), of(1.5)), (Some(0.0), Some(10.0)));
        assert_eq!(nearest_quantile(&mut [], 0.5), None);
        // By the nearest rank, ⌈0.5 · 4⌉, it would be 1.
        assert_eq!(nearest_quantile(&mut [10.0, 0.0, 4.0, 1.0], 0.5), Some(4.0));
        assert!(nearest_quantile(&mut [1.0, f64::NAN, 0.0], 0.0).is_some_and(f64::is_nan));
    }

    #[test]
    fn distinct_values_stay_where_they_are_first() {
        assert_eq!(distinct(["b", "a", "b", "c", "a"]), ["b", "a", "c"]);
    }

    #[test]
    fn keys_stay_where_they_are_first_with_their_values_in_order() {
        let found = grouped([("b", 3), ("a", 1), ("b", 2), ("b", 3)]);
        assert_eq!(found, [("b", vec![3, 2, 3]), ("a", vec![1])]);
    }
}
