use std::f64::consts::FRAC_PI_2;

use atsplat_numeric::{mean, median, quantile};
use serde::Serialize;

use crate::statistics::{CONFIDENCE, student_quantile};

/// Repeated measurements of one quantity on some trials. Each number is that of a trial's repetitions, averaged over the trials:
/// however often a trial was repeated, it counts once.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct Spread {
    /// The median.
    pub median: f64,
    /// Median absolute deviation, unscaled.
    pub mad: f64,
    /// First and third quartile.
    pub quartiles: [f64; 2],
    /// Number of measurements of all trials together.
    pub samples: u64,
    /// Half-width of the 95 % interval of [`Self::median`] over repetitions, for these fixed trials; 0 if no trial was repeated.
    pub error: f64,
}

impl Spread {
    /// The spread of each trial's repetitions, averaged over the trials that have any; `None` if none has.
    pub(super) fn of<'a>(trials: impl Iterator<Item = &'a [f64]>) -> Option<Self> {
        let trials: Vec<&[f64]> = trials.filter(|samples| !samples.is_empty()).collect();
        let each: Vec<Self> = trials.iter().filter_map(|samples| Self::of_trial(samples)).collect();
        let average = |value: fn(&Self) -> f64| mean(each.iter().map(value));
        let freedom = trials.iter().map(|samples| samples.len() - 1).sum();
        let variance = each.iter().map(Self::variance_of_median).sum::<f64>();
        let student = student_quantile(f64::midpoint(1.0, CONFIDENCE), freedom);
        Some(Self {
            median: average(|trial| trial.median)?,
            mad: average(|trial| trial.mad)?,
            quartiles: [average(|trial| trial.quartiles[0])?, average(|trial| trial.quartiles[1])?],
            samples: each.iter().map(|trial| trial.samples).sum(),
            error: student * variance.sqrt() / each.len() as f64,
        })
    }

    /// The spread of one trial's repetitions, without its error.
    fn of_trial(samples: &[f64]) -> Option<Self> {
        let mut sorted = samples.to_vec();
        sorted.sort_by(f64::total_cmp);
        let middle = median(sorted.iter().copied())?;
        Some(Self {
            median: middle,
            mad: median(sorted.iter().map(|value| (value - middle).abs()))?,
            quartiles: [quantile(&sorted, 0.25)?, quantile(&sorted, 0.75)?],
            samples: sorted.len() as u64,
            error: 0.0,
        })
    }

    /// Variance of the median of one trial's repetitions, estimated from their MAD for a normal distribution.
    fn variance_of_median(&self) -> f64 {
        // σ = 1.4826 · MAD; the variance of a median is π/2 · σ²/n.
        let deviation = 1.4826 * self.mad;
        FRAC_PI_2 * deviation * deviation / self.samples as f64
    }

    /// The sum of two consecutive times.
    pub(super) fn plus(self, other: Self) -> Self {
        Self {
            median: self.median + other.median,
            mad: self.mad + other.mad,
            quartiles: [self.quartiles[0] + other.quartiles[0], self.quartiles[1] + other.quartiles[1]],
            samples: if self.samples < other.samples { self.samples } else { other.samples },
            error: self.error.hypot(other.error),
        }
    }
}

#[cfg(test)]
mod tests {
    use atsplat_numeric::Tolerance;

    use super::*;

    /// Short work is repeated more often: of three trials, the fastest has more than half of the measurements.
    #[test]
    fn a_trial_counts_once_however_often_it_was_repeated() {
        let spread = Spread::of([&[1.0; 13][..], &[2.0; 7][..], &[9.0; 5][..]].into_iter()).unwrap();
        Tolerance::F64.assert([spread.median, spread.mad, spread.error], [4.0, 0.0, 0.0], "each is exact");
        Tolerance::F64.assert(spread.quartiles, [4.0, 4.0], "quartiles");
        assert_eq!(spread.samples, 25);
    }

    #[test]
    fn consecutive_times_are_added_and_their_errors_are_independent() {
        let encode = Spread { median: 1.0, mad: 0.25, quartiles: [0.5, 2.0], samples: 5, error: 3.0 };
        let render = Spread { median: 10.0, mad: 0.125, quartiles: [8.0, 16.0], samples: 3, error: 4.0 };
        let both = Spread { median: 11.0, mad: 0.375, quartiles: [8.5, 18.0], samples: 3, error: 5.0 };
        assert_eq!([encode.plus(render), render.plus(encode)], [both; 2]);
    }

    #[test]
    fn a_spread_is_averaged_over_trials() {
        let spread = Spread::of([&[1.0, 6.0, 2.0][..], &[100.0, 3.0][..], &[][..]].into_iter()).unwrap();
        // Medians 2 and 51.5, MADs 1 and 48.5.
        Tolerance::F64.assert([spread.median, spread.mad], [26.75, 24.75], "median and MAD");
        Tolerance::F64.assert(spread.quartiles, [14.375, 39.875], "quartiles");
        assert_eq!(spread.samples, 5);
        // Of three and two repetitions, with three degrees of freedom.
        let variance = FRAC_PI_2 * 1.4826 * 1.4826 * (1.0 / 3.0 + 48.5 * 48.5 / 2.0);
        Tolerance::absolute(1e-3).assert([spread.error], [3.182_446 * variance.sqrt() / 2.0], "error");
        assert_eq!(Spread::of([&[][..]].into_iter()), None);
        Tolerance::EXACT.assert([Spread::of([&[7.0][..]].into_iter()).unwrap().error], [0.0], "it was not repeated");
    }
}
