use std::cmp::Ordering;

/// Spearman's rank correlation of two lists, in [-1, 1]: Pearson's correlation of ranks, where ties have their mean rank.
/// `None` for lists that are shorter than two, differ in length, contain NaN, or are constant.
pub fn rank_correlation(a: &[f64], b: &[f64]) -> Option<f64> {
    if a.len() != b.len() || a.len() < 2 || a.iter().chain(b).any(|value| value.is_nan()) {
        return None;
    }
    let (a, b) = (ranks(a), ranks(b));
    let mean = f64::midpoint(a.len() as f64, 1.0);
    let products = |x: &[f64], y: &[f64]| x.iter().zip(y).map(|(x, y)| (x - mean) * (y - mean)).sum::<f64>();
    let spread = (products(&a, &a) * products(&b, &b)).sqrt();
    (spread > 0.0).then(|| products(&a, &b) / spread)
}

/// Ranks from 1; ties have their mean rank.
fn ranks(values: &[f64]) -> Vec<f64> {
    let mut order: Vec<(usize, f64)> = values.iter().copied().enumerate().collect();
    order.sort_by(|(_, a), (_, b)| a.total_cmp(b));
    let mut ranks = vec![0.0; values.len()];
    let mut before = 0;
    // Zeros of both signs are equal and adjacent in the order of `total_cmp`.
    let are_equal = |a: f64, b: f64| a.partial_cmp(&b) == Some(Ordering::Equal);
    for equal in order.chunk_by(|(_, a), (_, b)| are_equal(*a, *b)) {
        let shared = before as f64 + f64::midpoint(equal.len() as f64, 1.0);
        for (at, _) in equal {
            if let Some(rank) = ranks.get_mut(*at) {
                *rank = shared;
            }
        }
        before += equal.len();
    }
    ranks
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Tolerance;

    #[test]
    fn matches_scipy() {
        let a = [106.0, 100.0, 86.0, 101.0, 99.0, 103.0, 97.0, 113.0, 112.0, 110.0];
        let b = [7.0, 27.0, 2.0, 50.0, 28.0, 29.0, 20.0, 12.0, 6.0, 17.0];
        Tolerance::absolute(1e-12).assert(rank_correlation(&a, &b), [-0.175_757_575_757_575_75], "no ties");
        let tied = rank_correlation(&[1.0, 2.0, 2.0, 3.0, -0.0, 0.0], &[1.0, 3.0, 2.0, 2.0, 0.0, 1.0]);
        Tolerance::absolute(1e-12).assert(tied, [0.818_181_818_181_818], "ties");
    }

    #[test]
    fn extreme_and_undefined_correlations() {
        let rising = [1.0, 4.0, 9.0];
        Tolerance::absolute(1e-15).assert(rank_correlation(&rising, &[0.1, 0.2, 0.9]), [1.0], "the same order");
        Tolerance::absolute(1e-15).assert(rank_correlation(&rising, &[3.0, 2.0, 1.0]), [-1.0], "reversed");
        assert_eq!(rank_correlation(&rising, &[5.0; 3]), None);
        assert_eq!(rank_correlation(&rising, &[1.0, f64::NAN, 2.0]), None);
        assert_eq!(rank_correlation(&[1.0], &[1.0]), None);
        assert_eq!(rank_correlation(&rising, &[1.0]), None);
    }
}
