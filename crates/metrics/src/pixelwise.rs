use crate::sums::{Difference, sum_of_differences};
use crate::{Pair, Score, Values};

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

/// PSNR for a peak of 1: `−10 log₁₀` of the mean squared error.
pub fn psnr_of_mean_squared_error(error: f64) -> Score {
    if error == 0.0 { Score::Identical } else { Score::Value(-10.0 * error.log10()) }
}

fn mean(pair: &Pair<'_>, values: Values, difference: Difference) -> f64 {
    let [render, truth] = pair.rows(values);
    sum_of_differences(&render, &truth, difference) / render.len() as f64
}
