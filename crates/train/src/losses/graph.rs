//! The losses as operations of burn's graph, on whatever device the images are: for graphics adapters, where copying images to
//! the host takes longer than their losses. On the CPU, the closed forms in the other files here are faster.

use atsplat_metrics::ssim::gaussian;
use burn::Tensor;
use burn::tensor::{Device, TensorData};

const C1: f64 = 0.01 * 0.01;
const C2: f64 = 0.03 * 0.03;
/// Subtracted from the images, so that their variances keep more digits.
const GREY: f64 = 0.5;
/// What rounding may add to variances and covariances before they are restricted, as in [`atsplat_metrics::DSsim`].
const ROUNDING: f64 = 1e-6;

/// The mean of each sample's values; samples follow each other along the first dimension, with equal numbers of values.
pub fn means<const D: usize>(values: Tensor<D>, samples: usize) -> Tensor<1> {
    let each = values.shape().num_elements() / samples.max(1);
    values.reshape([samples, each]).mean_dim(1).squeeze_dim::<1>(1)
}

/// Mean squared error of each sample over its pixels, channels and views.
pub fn mse<const D: usize>(render: Tensor<D>, truth: Tensor<D>, samples: usize) -> Tensor<1> {
    means((render - truth).square(), samples)
}

/// Mean absolute difference between the rendered uncertainty and the error map, which is a constant, of each sample.
pub fn uncertainty(rendered: Tensor<3>, error_map: Tensor<3>, samples: usize) -> Tensor<1> {
    means((rendered - error_map.detach()).abs(), samples)
}

/// Mean absolute difference between the logarithms of predicted distances, `[samples, patches]`, and exact ones, of each sample as
/// [`super::log_distance`].
pub fn log_distance(predicted: Tensor<2>, exact: &[&[f32]]) -> Tensor<1> {
    let (samples, patches) = (exact.len(), exact.first().map_or(0, |exact| exact.len()));
    // Sky counts for nothing, whatever is predicted there.
    let tensor = |part: fn(f32) -> f32| {
        let values: Vec<f32> = exact.iter().flat_map(|exact| exact.iter().map(|exact| part(*exact))).collect();
        Tensor::<2>::from_data(TensorData::new(values, [samples, patches]), &predicted.device())
    };
    let weight = tensor(|exact| if exact == f32::INFINITY { 0.0 } else { 1.0 });
    let counts: Vec<f32> =
        exact.iter().map(|exact| exact.iter().filter(|exact| exact.is_finite()).count().max(1) as f32).collect();
    let counts = Tensor::<1>::from_data(TensorData::new(counts, [samples]), &predicted.device());
    let exact = tensor(|exact| if exact == f32::INFINITY { 1.0 } else { exact });
    let known = predicted * weight.clone() + (weight.clone() * -1.0 + 1.0);
    ((known.log() - exact.log()).abs() * weight).sum_dim(1).squeeze_dim::<1>(1) / counts
}

/// `1 − SSIM` as 3DGS's training computes it, of images of one size.
#[derive(Clone, Debug)]
pub struct DSsim {
    /// The window down the columns, `[1, 1, height, height]`.
    down: Tensor<4>,
    /// The window along the rows, `[1, 1, width, width]`.
    along: Tensor<4>,
    /// What of each pixel's window is outside the image, which is black there.
    outside: Tensor<4>,
}

impl DSsim {
    /// For images of `height × width` pixels on a device.
    pub fn new([height, width]: [usize; 2], device: &Device) -> Self {
        let [down, along] = [height, width]
            .map(|side| Tensor::<4>::from_data(TensorData::new(window(side), [1, 1, side, side]), device));
        let inside = down.clone().matmul(Tensor::ones([1, 1, height, width], device)).matmul(along.clone());
        Self { down, along, outside: inside * -1.0 + 1.0 }
    }

    /// `1 − SSIM` of images `[views, height, width, 3]` at each pixel and channel, `[views, 3, height, width]`.
    pub fn map(&self, render: Tensor<4>, truth: Tensor<4>) -> Tensor<4> {
        let [x, y] = [render, truth].map(|images| images.permute([0, 3, 1, 2]) - GREY);
        let [views, ..] = x.dims();
        let products = [x.clone().square() + y.clone().square(), x.clone() * y.clone()];
        let [squares, both] = products;
        let blurred = self.down.clone().matmul(Tensor::cat(vec![x, y, squares, both], 0)).matmul(self.along.clone());
        // A black pixel is −GREY here.
        let part = |at: usize, black: f64| {
            blurred.clone().slice_dim(0, at * views..(at + 1) * views) + self.outside.clone() * black
        };
        let [x, y] = [part(0, -GREY), part(1, -GREY)];
        let [squares, both] = [part(2, 2.0 * GREY * GREY), part(3, GREY * GREY)];
        let variances = squares - x.clone().square() - y.clone().square();
        let covariances = (both - x.clone() * y.clone()) * 2.0;
        let (covariances, variances) = restricted(covariances, variances);
        let [x, y] = [x + GREY, y + GREY];
        let similarity = (x.clone() * y.clone() * 2.0 + C1) * (covariances + C2)
            / ((x.square() + y.square() + C1) * (variances + C2));
        similarity * -1.0 + 1.0
    }
}

/// Twice the covariances, and the sums of variances, within what they can be except for [`ROUNDING`]: of renders far brighter than
/// white, rounding would make variances negative. Derivatives are those of the unrestricted values.
fn restricted(covariances: Tensor<4>, variances: Tensor<4>) -> (Tensor<4>, Tensor<4>) {
    let [covariance, variance] = [&covariances, &variances].map(|values| values.clone().detach());
    // Constants that are 0 almost everywhere: adding them changes no bits there.
    let missing = (variance.clone() * -1.0 - ROUNDING).clamp_min(0.0);
    let most = variance + missing.clone() + 2.0 * ROUNDING;
    let above = (covariance.clone() - most.clone()).clamp_min(0.0);
    let below = (covariance * -1.0 - most).clamp_min(0.0);
    (covariances - above + below, variances + missing)
}

/// The window around each of `side` pixels as a matrix, symmetric; zeros around the image are left out.
#[expect(clippy::cast_possible_truncation, reason = "the window in f32")]
fn window(side: usize) -> Vec<f32> {
    let taps = gaussian();
    let radius = taps.len() / 2;
    let tap = |from: usize, to: usize| taps.get((to + radius).wrapping_sub(from)).map_or(0.0, |tap| *tap as f32);
    (0..side * side).map(|at| tap(at / side, at % side)).collect()
}
