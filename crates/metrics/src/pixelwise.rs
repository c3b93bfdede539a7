use crate::sums::{Difference, sum_of_differences};
use crate::{MetricError, Pair, Score, Values};

/// Mean of squared differences over pixels and channels, in f64.
pub fn mean_squared_error(pair: &Pair<'_>, values: Values) -> f64 {
    mean(pair, values, Difference::Squared)
}

/// Mean of absolute differences over pixels and channels: MAE, L1.
pub fn l1(pair: &Pair<'_>, values: Values) -> f64 {
    mean(pair, values, Difference::Absolute)
}

/// Peak signal-to-noise ratio in dB for a peak of 1, one mean over the image's pixels and channels
/// (pixelSplat `src/evaluation/metrics.py:11-19` with [`Values::Clipped`]).
///
/// [`Score::Identical`] if no sample differs after the conversion by `values`: the ratio is infinite.
pub fn psnr(pair: &Pair<'_>, values: Values) -> Score {
    psnr_of_mean_squared_error(mean_squared_error(pair, values))
}

/// PSNR for a peak of 1: `−10 log₁₀` of the mean squared error. [`Score::NotComputed`] for NaN, infinities and negative numbers, as
/// of images that are not finite.
pub fn psnr_of_mean_squared_error(error: f64) -> Score {
    if error == 0.0 {
        Score::Identical
    } else if error > 0.0 && error.is_finite() {
        Score::Value(-10.0 * error.log10())
    } else {
        Score::NotComputed(MetricError::MeanSquaredError { found: error }.into())
    }
}

fn mean(pair: &Pair<'_>, values: Values, difference: Difference) -> f64 {
    let [render, truth] = pair.rows(values);
    sum_of_differences(&render, &truth, difference) / render.len() as f64
}

#[cfg(test)]
mod tests {
    use atsplat_numeric::Tolerance;

    use super::*;

    #[test]
    fn the_psnr_of_what_is_no_error_is_not_computed() {
        let value = |error: f64| psnr_of_mean_squared_error(error).value();
        let found = [0.01, 1.0, 100.0, f64::MAX].map(value).map(Option::unwrap);
        Tolerance::F64.assert(found, [20.0, 0.0, -20.0, -10.0 * f64::MAX.log10()], "of an error");
        assert_eq!(psnr_of_mean_squared_error(0.0), Score::Identical);
        for error in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY, -1e-9] {
            let score = psnr_of_mean_squared_error(error);
            assert!(matches!(score, Score::NotComputed(_)), "{error}: {score:?}");
        }
    }
}
