use atsplat_numeric::SplitMix64;
use atsplat_numeric::quantile;
use rayon::prelude::*;

use super::student::{normal_tail, student_quantile};

/// How often an interval should hold the truth.
pub const CONFIDENCE: f64 = 0.95;

/// Where the resampling starts; the same for every number, so that equal rows give equal intervals.
const SEED: u64 = 0x6174_7370_6c61_7421;
/// Resamples where there are few scenes, and at the least.
const MOST: usize = 10_000;
const LEAST: usize = 2_000;
/// Draws that an interval may take before it makes do with fewer resamples.
const DRAWS: usize = 10_000_000;

/// The 95 % interval of `Σ sum / Σ weight` over clusters given as `[sum, weight]`: the expanded percentile interval of a
/// bootstrap that draws whole clusters (Hesterberg: "What Teachers Should Know About the Bootstrap", The American
/// Statistician 69, 2015, section 4.1).
///
/// A plain percentile interval of `n` clusters is too short by `√((n − 1) / n)` and by the difference between Student's and
/// the normal distribution; taking percentiles further out, at `Φ(−√(n / (n − 1)) · t)`, makes up for both. The resamples
/// come from a fixed seed, each from a stream of its own, so that threads change no bit. No interval leaves the range of
/// what the clusters say: below six of them it is too short, whatever is done.
///
/// `None` with fewer than two clusters, or where a value is not finite or a weight not positive.
pub fn interval_of_mean(clusters: &[[f64; 2]]) -> Option<[f64; 2]> {
    let resamples = DRAWS.checked_div(clusters.len()).unwrap_or(MOST).clamp(LEAST, MOST);
    interval_of_resamples(clusters, resamples)
}

/// As [`interval_of_mean`], from this many resamples.
pub(super) fn interval_of_resamples(clusters: &[[f64; 2]], resamples: usize) -> Option<[f64; 2]> {
    let last = clusters.len().checked_sub(1).filter(|last| *last > 0)?;
    if clusters.iter().any(|[sum, weight]| !sum.is_finite() || !weight.is_finite() || *weight <= 0.0) {
        return None;
    }
    let mut seeds = SplitMix64::new(SEED);
    let seeds: Vec<u64> = (0..resamples).map(|_| seeds.next_u64()).collect();
    let mut means: Vec<f64> = seeds
        .into_par_iter()
        .map(|seed| {
            let mut random = SplitMix64::new(seed);
            let drawn = (0..=last).filter_map(|_| random.within(0..=last).and_then(|at| clusters.get(at)));
            let [sum, weight] = drawn.fold([0.0, 0.0], |[sum, weight], [s, w]| [sum + s, weight + w]);
            sum / weight
        })
        .collect();
    means.sort_by(f64::total_cmp);
    let count = clusters.len() as f64;
    let student = student_quantile(f64::midpoint(1.0, CONFIDENCE), last);
    let tail = normal_tail((count / (count - 1.0)).sqrt() * student);
    let interval = [quantile(&means, tail)?, quantile(&means, 1.0 - tail)?];
    interval.iter().all(|end| end.is_finite()).then_some(interval)
}
