use atsplat_numeric::median;
use serde::{Deserialize, Serialize};

use crate::{Mask, MetricError};

/// Depths along the camera's axis, row-major; a value that is not finite or not positive marks a pixel without depth.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DepthMap<'a> {
    size: [u32; 2],
    depths: &'a [f32],
}

impl<'a> DepthMap<'a> {
    /// One depth per pixel.
    ///
    /// # Errors
    /// [`MetricError::ValueCount`] unless there are `width · height` values.
    pub fn new(width: u32, height: u32, depths: &'a [f32]) -> Result<Self, MetricError> {
        let expected = u64::from(width) * u64::from(height);
        if depths.len() as u64 != expected {
            return Err(MetricError::ValueCount { what: "depth map", expected, found: depths.len() });
        }
        Ok(Self { size: [width, height], depths })
    }
}

/// Range of ground-truth depths that are compared, in the unit of the maps, including both ends.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub struct DepthRange {
    /// Smallest.
    pub near: f32,
    /// Largest.
    pub far: f32,
}

impl DepthRange {
    /// Every positive depth.
    pub const ALL: Self = Self { near: f32::MIN_POSITIVE, far: f32::MAX };
}

/// Scaling of rendered depths before they are compared; part of the convention.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum DepthScale {
    /// None: poses of known scale.
    Metric,
    /// Multiplied by median(truth) / median(render) of the picture, for methods with unknown scale
    /// (Zhou et al. 2017, `SfMLearner`'s `kitti_eval/eval_depth.py`).
    Median,
}

/// Standard errors of a rendered depth map (Eigen et al. 2014, section 4.1; DepthSplat `depth` branch).
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct DepthError {
    /// Compared pixels: those with rendered and ground-truth depth in the range.
    pub compared: u64,
    /// Pixels with ground-truth depth in the range but no rendered depth; they are not part of the errors below.
    pub missing: u64,
    /// Factor applied to rendered depths.
    pub scale: f64,
    /// Mean of |d − d*| / d*.
    pub abs_rel: f64,
    /// Mean of (d − d*)² / d*, in the unit of the maps.
    pub sq_rel: f64,
    /// Root mean square of d − d*, in the unit of the maps.
    pub rmse: f64,
    /// Root mean square of ln d − ln d*.
    pub rmse_log: f64,
    /// Fractions of pixels with max(d / d*, d* / d) below 1.25, 1.25², 1.25³.
    pub delta: [f64; 3],
}

/// Compares a rendered depth map with the ground truth, in f64 and row-major order.
///
/// # Errors
/// [`MetricError::SizeMismatch`]; [`MetricError::EmptyMask`] if no pixel has both depths.
pub fn depth_error(
    render: &DepthMap<'_>,
    truth: &DepthMap<'_>,
    mask: Option<&Mask>,
    range: DepthRange,
    scale: DepthScale,
) -> Result<DepthError, MetricError> {
    for (what, found) in [("true depth", truth.size), ("mask", mask.map_or(render.size, Mask::size))] {
        if found != render.size {
            return Err(MetricError::SizeMismatch { what, expected: render.size, found });
        }
    }
    let mut missing = 0;
    let mut compared = Vec::new();
    for (pixel, (render, truth)) in render.depths.iter().zip(truth.depths).enumerate() {
        let included = mask.is_none_or(|mask| mask.included().get(pixel) == Some(&true));
        if !included || !has_depth(*truth, range) {
            continue;
        }
        if *render > 0.0 && render.is_finite() {
            compared.push([f64::from(*render), f64::from(*truth)]);
        } else {
            missing += 1;
        }
    }
    let medians = [0, 1].map(|at| median(compared.iter().map(|pair| pair[at])));
    let [Some(render), Some(truth)] = medians else {
        return Err(MetricError::EmptyMask { expected: "at least one pixel with a rendered and a true depth" });
    };
    let scale = match scale {
        DepthScale::Metric => 1.0,
        DepthScale::Median => truth / render,
    };
    Ok(summarise(&compared, missing, scale))
}

/// Whether a ground-truth depth is valid and in the range.
fn has_depth(truth: f32, range: DepthRange) -> bool {
    truth > 0.0 && truth.is_finite() && truth >= range.near && truth <= range.far
}

fn summarise(compared: &[[f64; 2]], missing: u64, scale: f64) -> DepthError {
    let mut sums = [0.0; 4];
    let mut within = [0u64; 3];
    for [render, truth] in compared {
        let depth = render * scale;
        let (error, logarithm) = (depth - truth, depth.ln() - truth.ln());
        let terms = [error.abs() / truth, error * error / truth, error * error, logarithm * logarithm];
        sums.iter_mut().zip(terms).for_each(|(sum, term)| *sum += term);
        let ratio = if depth > *truth { depth / truth } else { truth / depth };
        within
            .iter_mut()
            .zip([1.25, 1.25 * 1.25, 1.25 * 1.25 * 1.25])
            .for_each(|(n, limit)| *n += u64::from(ratio < limit));
    }
    let count = compared.len() as f64;
    let [abs_rel, sq_rel, squares, logarithms] = sums.map(|sum| sum / count);
    DepthError {
        compared: compared.len() as u64,
        missing,
        scale,
        abs_rel,
        sq_rel,
        rmse: squares.sqrt(),
        rmse_log: logarithms.sqrt(),
        delta: within.map(|n| n as f64 / count),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use atsplat_numeric::Tolerance;

    fn errors(
        render: &[f32],
        truth: &[f32],
        mask: Option<&Mask>,
        scale: DepthScale,
    ) -> Result<DepthError, MetricError> {
        let map = |depths| DepthMap::new(2, 2, depths).unwrap();
        depth_error(&map(render), &map(truth), mask, DepthRange { near: 0.5, far: 10.0 }, scale)
    }

    #[test]
    fn errors_agree_with_a_manual_calculation() {
        let found = errors(&[1.0, 3.0, 2.0, f32::NAN], &[2.0, 2.0, 2.0, 4.0], None, DepthScale::Metric).unwrap();
        assert_eq!((found.compared, found.missing), (3, 1));
        let logs = ((0.5f64.ln().powi(2) + 1.5f64.ln().powi(2)) / 3.0).sqrt();
        let expected = [1.0 / 3.0, 1.0 / 3.0, (2.0f64 / 3.0).sqrt(), logs, 1.0 / 3.0, 2.0 / 3.0, 2.0 / 3.0];
        let values = [found.abs_rel, found.sq_rel, found.rmse, found.rmse_log];
        Tolerance::F64.assert(values.into_iter().chain(found.delta), expected, "errors");
    }

    #[test]
    fn median_scaling_removes_and_reports_a_factor() {
        let found = errors(&[2.0, 4.0, 6.0, 8.0], &[1.0, 2.0, 3.0, 4.0], None, DepthScale::Median).unwrap();
        Tolerance::F64.assert([found.scale, found.abs_rel, found.delta[0]], [0.5, 0.0, 1.0], "scaled");
    }

    #[test]
    fn pixels_without_ground_truth_or_outside_the_range_are_ignored() {
        let truth = [20.0, f32::INFINITY, -1.0, 1.0];
        let found = errors(&[1.0; 4], &truth, None, DepthScale::Metric).unwrap();
        assert_eq!((found.compared, found.missing), (1, 0));
        let mask = Mask::new(2, 2, vec![true, true, true, false]).unwrap();
        assert!(errors(&[1.0; 4], &truth, Some(&mask), DepthScale::Metric).is_err(), "nothing is left");
        assert!(errors(&[0.0; 4], &[1.0; 4], None, DepthScale::Median).is_err(), "nothing was rendered");
        let other = DepthMap::new(4, 1, &[1.0; 4]).unwrap();
        let square = DepthMap::new(2, 2, &[1.0; 4]).unwrap();
        assert!(depth_error(&square, &other, None, DepthRange::ALL, DepthScale::Metric).is_err());
        assert!(DepthMap::new(2, 2, &[1.0; 3]).is_err());
    }
}
