//! The loss of 3DGS, `(1 − λ) · L1 + λ · (1 − SSIM)`, and its gradient with respect to the rendered image.

use atsplat_camera::ImageSize;
use atsplat_metrics::DSsim;
use atsplat_numeric::narrowed;
use pulp::{Arch, Simd, WithSimd};
use rayon::prelude::*;

/// Values per task: of whole vectors, so that the order of sums is fixed.
const CHUNK: usize = 1 << 12;
const LANES: usize = 8;

/// The terms of the loss.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Terms {
    /// Mean absolute error.
    pub l1: f64,
    /// `1 − SSIM`.
    pub d_ssim: f64,
    /// Mean squared error of colours clamped to [0, 1], which is not part of the loss.
    pub mse: f64,
    /// The weighted sum.
    pub total: f64,
}

/// Evaluates losses and reuses its buffers.
#[derive(Debug, Default)]
pub struct PhotometricLoss {
    d_ssim: DSsim,
    dissimilar: Vec<f32>,
}

impl PhotometricLoss {
    /// The loss of an image, RGB row by row, as the truth; `weight` is λ, in [0, 1]. The gradient with respect to `render` replaces the
    /// contents of `gradient`.
    ///
    /// # Panics
    /// If an image has another number of pixels.
    pub fn evaluate(
        &mut self,
        render: &[[f32; 3]],
        truth: &[[f32; 3]],
        size: ImageSize,
        weight: f64,
        gradient: &mut Vec<[f32; 3]>,
    ) -> Terms {
        let (render, truth) = (render.as_flattened(), truth.as_flattened());
        let count = render.len() as f64;
        let sides = [size.width as usize, size.height as usize];
        let d_ssim = self.d_ssim.evaluate(render, truth, sides, &mut self.dissimilar) / count;
        gradient.resize(render.len() / 3, [0.0; 3]);
        let weights = [(1.0 - weight) / count, weight / count].map(narrowed);
        let images = render.par_chunks(CHUNK).zip(truth.par_chunks(CHUNK));
        let into = gradient.as_flattened_mut().par_chunks_mut(CHUNK).zip(self.dissimilar.par_chunks(CHUNK));
        let sums: Vec<[f64; 2]> = images
            .zip(into)
            .map(|(images, (into, dissimilar))| {
                Arch::new().dispatch(AbsoluteError { images, dissimilar, weights, into })
            })
            .collect();
        let [l1, mse] = sums.into_iter().fold([0.0; 2], |[a, b], [x, y]| [a + x, b + y]).map(|sum| sum / count);
        Terms { l1, d_ssim, mse, total: (1.0 - weight) * l1 + weight * d_ssim }
    }
}

/// Writes the gradient; returns the sums of absolute and of squared errors.
struct AbsoluteError<'a> {
    images: (&'a [f32], &'a [f32]),
    dissimilar: &'a [f32],
    weights: [f32; 2],
    into: &'a mut [f32],
}

impl WithSimd for AbsoluteError<'_> {
    type Output = [f64; 2];

    #[inline(always)]
    fn with_simd<S: Simd>(self, _simd: S) -> [f64; 2] {
        let Self { images: (render, truth), dissimilar, weights: [l1, d_ssim], into } = self;
        for ((slot, (x, y)), dissimilar) in into.iter_mut().zip(render.iter().zip(truth)).zip(dissimilar) {
            // The derivative of |error| at 0 is 0, as PyTorch's.
            let sign = if x > y { l1 } else { 0.0 } - if x < y { l1 } else { 0.0 };
            *slot = sign + d_ssim * dissimilar;
        }
        let ((vectors, rest), (truths, rest_of_truth)) = (render.as_chunks::<LANES>(), truth.as_chunks::<LANES>());
        let mut sums = [[0.0; LANES]; 2];
        for (x, y) in vectors.iter().zip(truths) {
            for (lane, (x, y)) in x.iter().zip(y).enumerate() {
                add(&mut sums, lane, *x, *y);
            }
        }
        rest.iter().zip(rest_of_truth).for_each(|(x, y)| add(&mut sums, 0, *x, *y));
        sums.map(|sums| sums.into_iter().sum())
    }
}

#[inline(always)]
fn add([absolute, squared]: &mut [[f64; LANES]; 2], lane: usize, x: f32, y: f32) {
    absolute[lane] += f64::from((x - y).abs());
    let error = f64::from(x.clamp(0.0, 1.0) - y);
    squared[lane] += error * error;
}
