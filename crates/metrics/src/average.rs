use serde::Serialize;

use crate::Score;

/// PSNR in dB that identical pictures count as in averages, where papers average the infinity. A convention of this toolkit,
/// equal to a root mean square error of 1e-5, far below the step of 8 bits.
pub const DECIBEL_CAP: f64 = 100.0;

/// A mean with its counts.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct Average {
    /// Mean over `counted` scores; `None` without any.
    pub mean: Option<f64>,
    /// Scores in the mean, including identical pictures.
    pub counted: u64,
    /// Identical pictures, each counted as `cap`.
    pub identical: u64,
    /// The value of an identical picture.
    pub cap: f64,
    /// Scores that were not computed and are not in the mean.
    pub not_computed: u64,
}

impl Average {
    /// The arithmetic mean, summed in the order given; identical pictures count as `cap`.
    pub fn of<'a>(scores: impl IntoIterator<Item = &'a Score>, cap: f64) -> Self {
        let mut average = Self { mean: None, counted: 0, identical: 0, cap, not_computed: 0 };
        let mut sum = 0.0;
        for score in scores {
            average.identical += u64::from(*score == Score::Identical);
            match score.capped(cap) {
                Some(value) => {
                    sum += value;
                    average.counted += 1;
                }
                None => average.not_computed += 1,
            }
        }
        average.mean = (average.counted > 0).then(|| sum / average.counted as f64);
        average
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::MetricError;
    use atsplat_numeric::Tolerance;

    #[test]
    fn identical_pictures_count_as_the_cap_and_missing_scores_do_not() {
        let missing = Score::NotComputed(MetricError::Empty { size: [0, 0] }.into());
        let average = Average::of(&[Score::Value(20.0), Score::Identical, missing.clone()], DECIBEL_CAP);
        Tolerance::EXACT.assert(average.mean, [60.0], "mean");
        assert_eq!((average.counted, average.identical, average.not_computed), (2, 1, 1));
        assert_eq!(Average::of(&[missing], DECIBEL_CAP).mean, None);
    }
}
