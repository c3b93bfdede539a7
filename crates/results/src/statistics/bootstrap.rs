use atsplat_numeric::{SplitMix64, quantile};
use rayon::prelude::*;

use super::significance::{normal_tail, student_quantile};

/// Nominal coverage of the intervals.
pub const CONFIDENCE: f64 = 0.95;

/// With fewer scenes no interval is published: it would be too short, since it cannot leave the range of the scenes'
/// values.
pub const MIN_SCENES: u64 = 6;

/// Seed of the resampling, fixed so that equal rows give equal intervals.
const SEED: u64 = 0x6174_7370_6c61_7421;
/// Number of resamples for few scenes, and the minimum.
const MAX_RESAMPLES: usize = 10_000;
const MIN_RESAMPLES: usize = 2_000;
/// Maximum number of draws of a scene per interval: with many scenes, there are fewer resamples.
const MAX_DRAWS: usize = 10_000_000;

/// The 95 % interval of `Σ sum / Σ weight` over clusters given as `[sum, weight]`: the expanded percentile interval of a
/// bootstrap that draws whole clusters (Hesterberg: "What Teachers Should Know About the Bootstrap", The American
/// Statistician 69, 2015, section 4.1).
///
/// A plain percentile interval of `n` clusters is too short by `√((n − 1) / n)` and by the difference between Student's and
/// the normal distribution; percentiles further out, at `Φ(−√(n / (n − 1)) · t)`, correct for both. Every resample has a
/// separate stream from a fixed seed, so results do not depend on threads. The interval cannot leave the range of the clusters'
/// values, so with fewer than six clusters it is too short.
///
/// `None` with fewer than two clusters, or if a value is not finite or a weight not positive.
pub fn interval_of_mean(clusters: &[[f64; 2]]) -> Option<[f64; 2]> {
    interval_of_resamples(clusters, resamples(clusters.len()))
}

/// Like [`interval_of_mean`] with this many resamples.
pub(super) fn interval_of_resamples(clusters: &[[f64; 2]], resamples: usize) -> Option<[f64; 2]> {
    if clusters.iter().any(|[sum, weight]| !sum.is_finite() || !weight.is_finite() || *weight <= 0.0) {
        return None;
    }
    interval_of(clusters, resamples, |[sum, weight]| sum / weight)
}

/// The number of resamples for this many clusters.
pub(super) fn resamples(clusters: usize) -> usize {
    MAX_DRAWS.checked_div(clusters).unwrap_or(MAX_RESAMPLES).clamp(MIN_RESAMPLES, MAX_RESAMPLES)
}

/// Like [`interval_of_mean`], of any statistic of the sums over clusters. Resamples without one, where it is NaN, are left out; `None`
/// if they are more than those beyond an end of the interval.
pub(super) fn interval_of<const N: usize>(
    clusters: &[[f64; N]],
    resamples: usize,
    statistic: impl Fn([f64; N]) -> f64 + Sync,
) -> Option<[f64; 2]> {
    let last = clusters.len().checked_sub(1).filter(|last| *last > 0)?;
    let mut seeds = SplitMix64::new(SEED);
    let seeds: Vec<u64> = (0..resamples).map(|_| seeds.next_u64()).collect();
    let mut values: Vec<f64> = seeds
        .into_par_iter()
        .map(|seed| {
            let mut random = SplitMix64::new(seed);
            let drawn = (0..=last).filter_map(|_| random.within(0..=last).and_then(|at| clusters.get(at)));
            statistic(drawn.fold([0.0; N], |sums, cluster| std::array::from_fn(|at| sums[at] + cluster[at])))
        })
        .collect();
    values.retain(|value| !value.is_nan());
    values.sort_by(f64::total_cmp);
    let count = clusters.len() as f64;
    let student = student_quantile(f64::midpoint(1.0, CONFIDENCE), last);
    let tail = normal_tail((count / (count - 1.0)).sqrt() * student);
    if (resamples - values.len()) as f64 > tail * resamples as f64 {
        return None;
    }
    let interval = [quantile(&values, tail)?, quantile(&values, 1.0 - tail)?];
    interval.iter().all(|end| end.is_finite()).then_some(interval)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Ten million draws in all, by 2,000 to 10,000 resamples.
    #[test]
    fn many_clusters_have_fewer_resamples() {
        assert_eq!([0, 8, 1000, 2000, 5601].map(resamples), [10_000, 10_000, 10_000, 5000, 2000]);
    }
}
