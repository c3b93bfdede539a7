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
        let tenths: usize = trials.iter().map(|samples| tenths_of_freedom(samples.len())).sum();
        let variance = each.iter().map(Self::variance_of_median).sum::<f64>();
        let student = student_quantile(f64::midpoint(1.0, CONFIDENCE), (tenths + 5) / 10);
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

    /// Variance of the median of one trial's repetitions, estimated from their quartiles for a normal distribution. One slow repetition
    /// in five does not change it, and unlike the MAD, quartiles of three repetitions tell more than their smaller distance.
    fn variance_of_median(&self) -> f64 {
        if self.samples < 2 {
            return 0.0;
        }
        // Of many repetitions, the quartiles are 1.349 σ apart, and the variance of the median is π/2 · σ²/n; with n − 1.1, the
        // estimate is right on average within 15 % for any number of them.
        let deviation = (self.quartiles[1] - self.quartiles[0]) / 1.349;
        FRAC_PI_2 * deviation * deviation / (self.samples as f64 - 1.1)
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

/// Ten times the degrees of freedom of [`Spread::variance_of_median`] for this many repetitions, at least one. Quartiles of up to three
/// tell as much as a standard deviation, those of more as much as one of 0.4 times as many.
const fn tenths_of_freedom(repetitions: usize) -> usize {
    if repetitions < 4 { 10 * (repetitions - 1) } else { 4 * repetitions }
}

#[cfg(test)]
mod tests {
    use atsplat_numeric::{SplitMix64, Tolerance};

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
        // Quartiles 2.5 and 48.5 apart, of three and two repetitions, with three degrees of freedom.
        let variance = FRAC_PI_2 / (1.349 * 1.349) * (2.5 * 2.5 / 1.9 + 48.5 * 48.5 / 0.9);
        Tolerance::absolute(1e-3).assert([spread.error], [3.182_446 * variance.sqrt() / 2.0], "error");
        assert_eq!(Spread::of([&[][..]].into_iter()), None);
        Tolerance::EXACT.assert([Spread::of([&[7.0][..]].into_iter()).unwrap().error], [0.0], "it was not repeated");
    }

    /// Normal noise around the same time, as often as the default plan repeats trials, as often as long work, and in other numbers.
    #[test]
    fn errors_have_their_nominal_coverage() {
        let mut random = SplitMix64::new(5);
        for (trials, repetitions) in [(3, 2), (3, 3), (3, 5), (3, 13), (1, 2), (1, 3), (1, 5), (8, 2), (8, 5)] {
            let samples = 4000;
            let mut held = 0;
            for _ in 0..samples {
                let mut noise = || (0..12).map(|_| random.unit()).sum::<f64>() - 6.0;
                let each: Vec<Vec<f64>> = (0..trials).map(|_| (0..repetitions).map(|_| noise()).collect()).collect();
                let found = Spread::of(each.iter().map(Vec::as_slice)).unwrap();
                held += u32::from(found.median.abs() <= found.error);
            }
            let share = f64::from(held) / f64::from(samples);
            assert!((0.93..=0.97).contains(&share), "{share} of {trials} trials with {repetitions} repetitions");
        }
    }

    /// A tenth of a second in which the machine did something else.
    #[test]
    fn one_slow_repetition_of_five_does_not_widen_the_error() {
        let error = |last: f64| Spread::of(std::iter::once(&[0.010, 0.012, 0.011, 0.009, last][..])).unwrap().error;
        Tolerance::F64.assert([error(0.1)], [error(0.013)], "error");
        assert!(error(0.1) > 0.0);
    }
}
