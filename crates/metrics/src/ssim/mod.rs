//! Structural similarity (Wang et al. 2004) as common implementations compute it: they differ in window, border handling and
//! covariance.

mod filter;
mod similarity;

use atsplat_numeric::Extremes;
use serde::{Deserialize, Serialize};

use crate::{MetricError, Pair, Values, sums};

/// A convention of SSIM. All use the constants for a data range of 1: C1 = 0.01², C2 = 0.03².
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub struct Ssim {
    /// Weights of a neighbourhood.
    pub window: Window,
    /// Border handling.
    pub border: Border,
    /// Normalisation of variances and covariances.
    pub covariance: Covariance,
}

/// Separable window: the weights are the products of one row and one column of taps.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Window {
    /// 11×11, a Gaussian of standard deviation 1.5 pixels, normalised.
    Gaussian11,
    /// 7×7, uniform.
    Uniform7,
}

impl Window {
    /// Pixels from the centre to the edge.
    pub const fn radius(self) -> u32 {
        match self {
            Self::Gaussian11 => 5,
            Self::Uniform7 => 3,
        }
    }

    /// Pixels in the window.
    pub const fn pixels(self) -> u32 {
        let side = 2 * self.radius() + 1;
        side * side
    }
}

/// Treatment of windows that extend beyond the image.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Border {
    /// Only windows completely inside the image count.
    Inside,
    /// Every pixel has a window; the image is black outside.
    Zeros,
    /// Every pixel has a window; the image is mirrored at its outermost pixels, which are not repeated.
    Reflected,
}

/// Normalisation of variances and covariances.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Covariance {
    /// Of the sample: `n / (n − 1)` times the population's, n being the window's number of pixels (121 or 49).
    Sample,
    /// Of the population.
    Population,
}

impl Ssim {
    /// `skimage.metrics.structural_similarity(win_size=11, gaussian_weights=True, data_range=1)`, which pixelSplat
    /// (`src/evaluation/metrics.py`), MVSplat, DepthSplat, NoPoSplat and iLRM call.
    pub const SKIMAGE_GAUSSIAN: Self =
        Self { window: Window::Gaussian11, border: Border::Inside, covariance: Covariance::Sample };
    /// `skimage.metrics.structural_similarity(data_range=1)`, a flat 7×7 window, which Long-LRM calls (`model/loss.py`).
    pub const SKIMAGE_UNIFORM: Self =
        Self { window: Window::Uniform7, border: Border::Inside, covariance: Covariance::Sample };
    /// `ssim` of graphdeco-inria/gaussian-splatting (`utils/loss_utils.py`): zeros around the image.
    pub const INRIA: Self =
        Self { window: Window::Gaussian11, border: Border::Zeros, covariance: Covariance::Population };
    /// pytorch-msssim, and Google's JAX code since mip-NeRF: windows inside the image. Clamps of negative variances
    /// act only on rounding errors.
    pub const VALID: Self =
        Self { window: Window::Gaussian11, border: Border::Inside, covariance: Covariance::Population };
    /// `torchmetrics.StructuralSimilarityIndexMeasure(data_range=1)` as of 1.9, which includes the mirrored border.
    pub const TORCHMETRICS: Self =
        Self { window: Window::Gaussian11, border: Border::Reflected, covariance: Covariance::Population };

    /// Smallest supported width and height.
    pub const fn smallest_side(self) -> u32 {
        match self.border {
            Border::Inside => 2 * self.window.radius() + 1,
            Border::Zeros => 1,
            Border::Reflected => self.window.radius() + 1,
        }
    }

    /// Width of the border without window centres.
    const fn margin(self) -> u32 {
        match self.border {
            Border::Inside => self.window.radius(),
            Border::Zeros | Border::Reflected => 0,
        }
    }
}

/// Mean structural similarity over windows and channels, in [−1, 1]; 1 for identical images.
///
/// # Errors
/// [`MetricError::TooSmall`].
pub fn ssim(pair: &Pair<'_>, values: Values, convention: Ssim) -> Result<f64, MetricError> {
    let windows = windows(pair.size(), convention)?;
    let rows = similarity::rows(&pair.rows(values), pair.size(), convention, sums::sum);
    Ok(rows.iter().sum::<f64>() / (3.0 * windows as f64))
}

/// Structural similarity at every window's centre, averaged over channels; row-major, finite, in [−1, 1].
///
/// The map covers all window centres and is smaller than the images for [`Border::Inside`].
///
/// # Errors
/// [`MetricError::TooSmall`].
pub fn ssim_map(pair: &Pair<'_>, values: Values, convention: Ssim) -> Result<Vec<f64>, MetricError> {
    windows(pair.size(), convention)?;
    let rows = similarity::rows(&pair.rows(values), pair.size(), convention, |similarity| {
        similarity.as_chunks::<3>().0.iter().map(|[r, g, b]| (r + g + b) / 3.0).collect::<Vec<f64>>()
    });
    Ok(rows.concat().into_iter().map(|value| value.maximum_of(-1.0).minimum_of(1.0)).collect())
}

/// Taps of [`Window::Gaussian11`], whose sum is 1.
pub fn gaussian() -> [f64; 11] {
    let mut taps = [0.0; 11];
    for (tap, offset) in taps.iter_mut().zip(-5i8..=5) {
        *tap = (-0.5 * (f64::from(offset) / 1.5).powi(2)).exp();
    }
    let sum: f64 = taps.iter().sum();
    taps.map(|tap| tap / sum)
}

/// Taps of [`Window::Uniform7`].
const fn uniform() -> [f64; 7] {
    [1.0 / 7.0; 7]
}

/// Number of windows.
fn windows([width, height]: [u32; 2], convention: Ssim) -> Result<usize, MetricError> {
    let smallest = convention.smallest_side();
    if width < smallest || height < smallest {
        return Err(MetricError::TooSmall { measure: "SSIM", smallest, size: [width, height] });
    }
    let [columns, rows] = [width, height].map(|side| (side - 2 * convention.margin()) as usize);
    Ok(columns * rows)
}

#[cfg(test)]
mod tests;
