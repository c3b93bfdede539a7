//! The loss of 3DGS, `(1 − λ) · L1 + λ · (1 − SSIM)`, and its gradient with respect to the rendered picture.
//!
//! SSIM is that of graphdeco-inria/gaussian-splatting `utils/loss_utils.py`: an 11×11 Gaussian window of standard deviation
//! 1.5, black outside the picture, variances of the population; the mean over pixels and channels. Rows are computed in
//! parallel, each in a fixed order, so that results do not depend on the number of threads.

use atsplat_camera::ImageSize;
use pulp::Arch;
use rayon::prelude::*;

const TAPS: usize = 11;
const RADIUS: usize = TAPS / 2;
const CHANNELS: usize = 3;
const C1: f32 = 0.01 * 0.01;
const C2: f32 = 0.03 * 0.03;

/// Quantities whose blurred values SSIM needs: `x`, `y`, `x² + y²`, `xy`.
const BLURRED: usize = 4;
/// Derivatives of `1 − SSIM` with respect to the blurred `x`, `x²` and `xy`.
const DERIVATIVES: usize = 3;

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
#[derive(Debug)]
pub struct Photometric {
    taps: [f32; TAPS],
    /// Rows of [`BLURRED`] horizontally blurred quantities, with black rows above and below.
    across: Vec<f32>,
    /// As `across`, of the derivatives.
    derivatives: Vec<f32>,
    /// Sums over each row: of `1 − SSIM`, of absolute and of squared errors.
    sums: Vec<[f64; 3]>,
}

impl Default for Photometric {
    fn default() -> Self {
        let weights: [f64; TAPS] =
            std::array::from_fn(|tap| (-0.5 * ((tap as f64 - RADIUS as f64) / 1.5).powi(2)).exp());
        let sum: f64 = weights.iter().sum();
        let taps = weights.map(|weight| crate::scene::narrowed(weight / sum));
        Self { taps, across: Vec::new(), derivatives: Vec::new(), sums: Vec::new() }
    }
}

impl Photometric {
    /// The loss of a picture; its gradient replaces the contents of `gradient`. Both pictures have `size`, row by row.
    pub fn evaluate(
        &mut self,
        render: &[[f32; 3]],
        truth: &[[f32; 3]],
        size: ImageSize,
        weight: f64,
        gradient: &mut Vec<[f32; 3]>,
    ) -> Terms {
        let row = size.width as usize * CHANNELS;
        let height = size.height as usize;
        let count = (row * height) as f64;
        let taps = self.taps;
        let padded = (height + 2 * RADIUS) * row;
        // The rows above and below are never written.
        if self.across.len() != padded * BLURRED {
            self.across = vec![0.0; padded * BLURRED];
            self.derivatives = vec![0.0; padded * DERIVATIVES];
        }
        self.sums.resize(height, [0.0; 3]);
        gradient.resize(size.width as usize * height, [0.0; 3]);
        let (render, truth) = (render.as_flattened(), truth.as_flattened());

        let lines = render.par_chunks_exact(row).zip(truth.par_chunks_exact(row));
        let into = self.across.par_chunks_exact_mut(row * BLURRED).skip(RADIUS);
        into.zip(lines).for_each_init(
            || Scratch::new(row),
            |scratch, (into, (render, truth))| Arch::new().dispatch(|| scratch.quantities(&taps, render, truth, into)),
        );

        let across = &self.across;
        let into = self.derivatives.par_chunks_exact_mut(row * DERIVATIVES).skip(RADIUS).take(height);
        into.zip(&mut self.sums).enumerate().for_each_init(
            || Scratch::new(row),
            |scratch, (at, (into, sums))| {
                sums[0] =
                    Arch::new().dispatch(|| scratch.dissimilarity(&taps, window(across, at, row * BLURRED), into));
            },
        );

        let derivatives = &self.derivatives;
        #[expect(clippy::cast_possible_truncation, reason = "gradients are f32")]
        let weights = [(1.0 - weight) / count, weight / count].map(|weight| weight as f32);
        let lines = render.par_chunks_exact(row).zip(truth.par_chunks_exact(row));
        let into = gradient.as_flattened_mut().par_chunks_exact_mut(row).zip(&mut self.sums);
        into.zip(lines).enumerate().for_each_init(
            || Scratch::new(row),
            |scratch, (at, ((into, sums), lines))| {
                let window = window(derivatives, at, row * DERIVATIVES);
                [sums[1], sums[2]] = Arch::new().dispatch(|| scratch.gradient(&taps, window, lines, weights, into));
            },
        );
        let [d_ssim, l1, mse] = self.sums.iter().fold([0.0; 3], |[a, b, c], [x, y, z]| [a + x, b + y, c + z]);
        let (d_ssim, l1, mse) = (d_ssim / count, l1 / count, mse / count);
        Terms { l1, d_ssim, mse, total: (1.0 - weight) * l1 + weight * d_ssim }
    }
}

/// The rows from `at - RADIUS` to `at + RADIUS` of a padded buffer.
fn window(rows: &[f32], at: usize, length: usize) -> [&[f32]; TAPS] {
    std::array::from_fn(|tap| rows.get((at + tap) * length..(at + tap + 1) * length).unwrap_or(&[]))
}

/// Buffers of one task.
struct Scratch {
    row: usize,
    padded: Vec<f32>,
    blurred: Vec<f32>,
    derivatives: Vec<f32>,
}

impl Scratch {
    fn new(row: usize) -> Self {
        Self {
            row,
            padded: vec![0.0; row + 2 * RADIUS * CHANNELS],
            blurred: vec![0.0; row * BLURRED],
            derivatives: vec![0.0; row * DERIVATIVES],
        }
    }

    /// Blurs the four quantities of a row.
    #[inline(always)]
    fn quantities(&mut self, taps: &[f32; TAPS], render: &[f32], truth: &[f32], into: &mut [f32]) {
        let quantities: [fn(f32, f32) -> f32; BLURRED] = [|x, _| x, |_, y| y, |x, y| x * x + y * y, |x, y| x * y];
        for (quantity, into) in quantities.into_iter().zip(into.chunks_exact_mut(self.row)) {
            for ((slot, x), y) in self.padded.iter_mut().skip(RADIUS * CHANNELS).zip(render).zip(truth) {
                *slot = quantity(*x, *y);
            }
            blur_row(taps, &self.padded, into);
        }
    }

    /// Completes the blur down the columns, and blurs the derivatives of the row; returns the sum of `1 − SSIM`.
    #[inline(always)]
    fn dissimilarity(&mut self, taps: &[f32; TAPS], window: [&[f32]; TAPS], into: &mut [f32]) -> f64 {
        weighted_sum(taps, window, &mut self.blurred);
        let row = self.row;
        let (mean_x, rest) = self.blurred.split_at(row);
        let (mean_y, rest) = rest.split_at(row);
        let (squares, products) = rest.split_at(row);
        let (by_mean, rest) = self.derivatives.split_at_mut(row);
        let (by_square, by_product) = rest.split_at_mut(row);
        let mut sum = 0.0;
        let inputs = mean_x.iter().zip(mean_y).zip(squares.iter().zip(products));
        let outputs = by_mean.iter_mut().zip(by_square.iter_mut().zip(by_product));
        for (((mx, my), (square, product)), (by_mean, (by_square, by_product))) in inputs.zip(outputs) {
            let (means, cross) = (mx * mx + my * my, mx * my);
            let (a1, a2) = (2.0 * cross + C1, 2.0 * (product - cross) + C2);
            let (b1, b2) = (means + C1, square - means + C2);
            let (over, similarity) = (1.0 / (b1 * b2), a1 * a2 / (b1 * b2));
            sum += f64::from(1.0 - similarity);
            *by_mean = 2.0 * (mx * similarity * (1.0 / b1 - 1.0 / b2) - my * (a2 - a1) * over);
            *by_square = similarity / b2;
            *by_product = -2.0 * a1 * over;
        }
        for (from, into) in self.derivatives.chunks_exact(row).zip(into.chunks_exact_mut(row)) {
            for (slot, value) in self.padded.iter_mut().skip(RADIUS * CHANNELS).zip(from) {
                *slot = *value;
            }
            blur_row(taps, &self.padded, into);
        }
        sum
    }

    /// The gradient of a row; returns the sums of absolute and of squared errors.
    #[inline(always)]
    fn gradient(
        &mut self,
        taps: &[f32; TAPS],
        window: [&[f32]; TAPS],
        (render, truth): (&[f32], &[f32]),
        [l1, d_ssim]: [f32; 2],
        into: &mut [f32],
    ) -> [f64; 2] {
        let blurred = &mut self.derivatives;
        weighted_sum(taps, window, blurred);
        let (mean, rest) = blurred.split_at(self.row);
        let (square, product) = rest.split_at(self.row);
        let (mut absolute, mut squared) = (0.0, 0.0);
        let derivatives = mean.iter().zip(square.iter().zip(product));
        for ((slot, (x, y)), (mean, (square, product))) in
            into.iter_mut().zip(render.iter().zip(truth)).zip(derivatives)
        {
            let error = x - y;
            absolute += f64::from(error.abs());
            squared += f64::from(x.clamp(0.0, 1.0) - y).powi(2);
            // The derivative of |error| at 0 is 0, as PyTorch's.
            let sign = if error > 0.0 { l1 } else { 0.0 } - if error < 0.0 { l1 } else { 0.0 };
            *slot = sign + d_ssim * (mean + 2.0 * x * square + y * product);
        }
        [absolute, squared]
    }
}

/// Blurs a row, given with [`RADIUS`] black pixels at each end.
#[inline(always)]
fn blur_row(taps: &[f32; TAPS], padded: &[f32], into: &mut [f32]) {
    let length = into.len();
    let shifted = std::array::from_fn(|tap| padded.get(tap * CHANNELS..tap * CHANNELS + length).unwrap_or(&[]));
    weighted_sum(taps, shifted, into);
}

/// `Σ taps[k] · rows[k]` for symmetric taps.
#[inline(always)]
fn weighted_sum(taps: &[f32; TAPS], rows: [&[f32]; TAPS], into: &mut [f32]) {
    let length = into.len();
    let rows = rows.map(|row| &row[..length]);
    for (at, slot) in into.iter_mut().enumerate() {
        let mut sum = taps[RADIUS] * rows[RADIUS][at];
        for tap in 0..RADIUS {
            sum += taps[tap] * (rows[tap][at] + rows[TAPS - 1 - tap][at]);
        }
        *slot = sum;
    }
}
