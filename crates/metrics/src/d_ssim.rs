//! Structural dissimilarity as a loss: `1 − SSIM` as 3DGS's training computes SSIM ([`crate::Ssim::INRIA`]), with its
//! gradient.
//!
//! Computed in f32. SSIM's variances do not change when a constant is subtracted from the images, so that values relative
//! to mid-grey keep more of their digits. Rows are computed in parallel, each in a fixed order, and nothing is fused: the bits
//! depend neither on the number of threads nor on the instruction set.
//!
//! Renders may be far brighter than white. There, rounding exceeds the variances: they would become negative, and the divisor of
//! SSIM with them. So variances and covariances are kept within what they can be. Derivatives stay those of the unrestricted
//! values: what neighbouring pixels contribute nearly cancels, and with 0 at some of them it would not.

#![expect(clippy::inline_always, reason = "what is not inlined into the dispatched function loses its instructions")]

use atsplat_numeric::narrowed;
use pulp::{Arch, Simd, WithSimd};
use rayon::prelude::*;

use crate::ssim::gaussian;

const TAPS: usize = 11;
const RADIUS: usize = TAPS / 2;
const CHANNELS: usize = 3;
const C1: f32 = 0.01 * 0.01;
const C2: f32 = 0.03 * 0.03;

/// Several times what rounding adds to a variance or covariance of images in [0, 1], whose values therefore stay as they are; a
/// thousandth of [`C2`].
const ROUNDING: f32 = 1e-6;

/// What is subtracted from the images.
const GREY: f32 = 0.5;
/// Blurred quantities of the images less [`GREY`], where both are black: `x`, `y`, `x² + y²`, `xy`.
const BLACK: [f32; 4] = [-GREY, -GREY, 2.0 * GREY * GREY, GREY * GREY];
const BLURRED: usize = BLACK.len();
/// Derivatives of `1 − SSIM` with respect to the blurred `x`, `x²` and `xy`.
const DERIVATIVES: usize = 3;

/// Rows are padded to a multiple of this many values, which the compiler turns into vectors.
const LANES: usize = 16;
/// Fewest rows per task.
const ROWS: usize = 8;

/// Computes the loss of images and reuses its buffers.
#[derive(Clone, Debug, Default)]
pub struct DSsim {
    row: usize,
    height: usize,
    /// Rows of [`BLURRED`] horizontally blurred quantities, with black rows above and below.
    across: Vec<f32>,
    /// As `across`, of the derivatives, which are zero above and below.
    derivatives: Vec<f32>,
    values: Vec<f32>,
}

impl DSsim {
    /// The sum of `1 − SSIM` over all pixels and channels, and its gradient with respect to the render. Both images have
    /// `width × height` pixels of three interleaved values, row by row, and so has the gradient. Values that are not finite
    /// make the sum NaN or infinite.
    ///
    /// # Panics
    /// If an image has another number of values.
    pub fn evaluate(
        &mut self,
        render: &[f32],
        truth: &[f32],
        [width, height]: [usize; 2],
        gradient: &mut Vec<f32>,
    ) -> f64 {
        let row = width * CHANNELS;
        assert_eq!([render.len(), truth.len()], [row * height; 2], "values of two images of {width}×{height} pixels");
        gradient.resize(row * height, 0.0);
        if row * height == 0 {
            return 0.0;
        }
        self.fit(row, height);
        let stride = row.next_multiple_of(LANES);
        let (arch, taps, scratch) = (Arch::new(), gaussian().map(narrowed), || Scratch::new(row));

        let into = self.across.par_chunks_exact_mut(stride * BLURRED).skip(RADIUS);
        into.zip(rows(render, row).zip(rows(truth, row))).for_each_init(scratch, |scratch, (into, (render, truth))| {
            arch.dispatch(Row { scratch, taps: &taps, work: Work::Quantities { render, truth }, into });
        });

        let across = &self.across;
        let into = self.derivatives.par_chunks_exact_mut(stride * DERIVATIVES).skip(RADIUS);
        let into = into.zip(self.values.par_chunks_exact_mut(row)).enumerate().with_min_len(ROWS);
        let compute = |scratch: &mut Scratch, (at, (into, values)): (usize, (&mut [f32], &mut [f32]))| {
            let work = Work::Dissimilarity { blurred: window(across, at, stride * BLURRED), values };
            arch.dispatch(Row { scratch, taps: &taps, work, into })
        };
        let sums: Vec<f64> = into.map_init(scratch, compute).collect();

        let derivatives = &self.derivatives;
        let into = gradient.par_chunks_exact_mut(row).zip(rows(render, row).zip(rows(truth, row))).enumerate();
        into.for_each_init(scratch, |scratch, (at, (into, (render, truth)))| {
            let work = Work::Gradient { blurred: window(derivatives, at, stride * DERIVATIVES), render, truth };
            arch.dispatch(Row { scratch, taps: &taps, work, into });
        });
        sums.into_iter().sum()
    }

    /// `1 − SSIM` of the last images, for each pixel and channel.
    pub fn values(&self) -> &[f32] {
        &self.values
    }

    fn fit(&mut self, row: usize, height: usize) {
        if (self.row, self.height) == (row, height) {
            return;
        }
        (self.row, self.height) = (row, height);
        let (stride, padded) = (row.next_multiple_of(LANES), height + 2 * RADIUS);
        let black = BLACK.iter().flat_map(|black| std::iter::repeat_n(*black, stride));
        // The rows above and below stay as they are.
        self.across = black.cycle().take(padded * stride * BLURRED).collect();
        self.derivatives = vec![0.0; padded * stride * DERIVATIVES];
        self.values = vec![0.0; row * height];
    }
}

fn rows(values: &[f32], row: usize) -> impl IndexedParallelIterator<Item = &[f32]> {
    values.par_chunks_exact(row).with_min_len(ROWS)
}

/// The rows from `at - RADIUS` to `at + RADIUS` of a padded buffer.
fn window(rows: &[f32], at: usize, length: usize) -> [&[f32]; TAPS] {
    std::array::from_fn(|tap| &rows[(at + tap) * length..][..length])
}

/// What is computed of a row, in vectors.
struct Row<'a> {
    scratch: &'a mut Scratch,
    taps: &'a [f32; TAPS],
    work: Work<'a>,
    into: &'a mut [f32],
}

enum Work<'a> {
    Quantities { render: &'a [f32], truth: &'a [f32] },
    Dissimilarity { blurred: [&'a [f32]; TAPS], values: &'a mut [f32] },
    Gradient { blurred: [&'a [f32]; TAPS], render: &'a [f32], truth: &'a [f32] },
}

impl WithSimd for Row<'_> {
    type Output = f64;

    #[inline(always)]
    fn with_simd<S: Simd>(self, _simd: S) -> f64 {
        let Self { scratch, taps, work, into } = self;
        match work {
            Work::Quantities { render, truth } => scratch.quantities(taps, render, truth, into),
            Work::Dissimilarity { blurred, values } => return scratch.dissimilarity(taps, blurred, values, into),
            Work::Gradient { blurred, render, truth } => scratch.gradient(taps, blurred, render, truth, into),
        }
        0.0
    }
}

/// Buffers of one task.
struct Scratch {
    stride: usize,
    /// One row with [`RADIUS`] pixels at each end.
    padded: Vec<f32>,
    blurred: Vec<f32>,
    derivatives: Vec<f32>,
}

impl Scratch {
    fn new(row: usize) -> Self {
        let stride = row.next_multiple_of(LANES);
        Self {
            stride,
            padded: vec![0.0; stride + 2 * RADIUS * CHANNELS],
            blurred: vec![0.0; stride * BLURRED],
            derivatives: vec![0.0; stride * DERIVATIVES],
        }
    }

    /// Blurs the four quantities of a row.
    #[inline(always)]
    fn quantities(&mut self, taps: &[f32; TAPS], render: &[f32], truth: &[f32], into: &mut [f32]) {
        let (images, (means, rest)) = ((render, truth), into.split_at_mut(2 * self.stride));
        let ((mean_x, mean_y), (squares, products)) = (means.split_at_mut(self.stride), rest.split_at_mut(self.stride));
        self.blur_quantity(taps, images, BLACK[0], mean_x, |x, _| x);
        self.blur_quantity(taps, images, BLACK[1], mean_y, |_, y| y);
        self.blur_quantity(taps, images, BLACK[2], squares, |x, y| x * x + y * y);
        self.blur_quantity(taps, images, BLACK[3], products, |x, y| x * y);
    }

    #[inline(always)]
    fn blur_quantity(
        &mut self,
        taps: &[f32; TAPS],
        (render, truth): (&[f32], &[f32]),
        black: f32,
        into: &mut [f32],
        quantity: impl Fn(f32, f32) -> f32,
    ) {
        self.padded.fill(black);
        for ((slot, x), y) in self.padded[RADIUS * CHANNELS..].iter_mut().zip(render).zip(truth) {
            *slot = quantity(x - GREY, y - GREY);
        }
        blur_row(taps, &self.padded, into);
    }

    /// Completes the blur down the columns, and blurs the derivatives of the row; returns the sum of `1 − SSIM`.
    #[inline(always)]
    fn dissimilarity(
        &mut self,
        taps: &[f32; TAPS],
        window: [&[f32]; TAPS],
        values: &mut [f32],
        into: &mut [f32],
    ) -> f64 {
        weighted_sum(taps, window, &mut self.blurred);
        let stride = self.stride;
        let (mean_x, rest) = self.blurred.split_at(stride);
        let (mean_y, rest) = rest.split_at(stride);
        let (squares, products) = rest.split_at(stride);
        let (by_mean, rest) = self.derivatives.split_at_mut(stride);
        let (by_square, by_product) = rest.split_at_mut(stride);
        let inputs = mean_x.iter().zip(mean_y).zip(squares.iter().zip(products));
        let outputs = by_mean.iter_mut().zip(by_square.iter_mut().zip(by_product));
        for ((((x, y), (square, product)), (by_mean, (by_square, by_product))), value) in
            inputs.zip(outputs).zip(values.iter_mut())
        {
            // All terms are arranged so that equal images have a loss and a gradient of exactly 0.
            let (mx, my) = (x + GREY, y + GREY);
            let (a1, b1) = (2.0 * mx * my + C1, mx * mx + my * my + C1);
            let (covariance, variance) = restricted(2.0 * (product - x * y), square - (x * x + y * y));
            let (a2, b2) = (covariance + C2, variance + C2);
            let (over, similarity) = (1.0 / (b1 * b2), a1 * a2 / (b1 * b2));
            *value = 1.0 - similarity;
            let (by_variance, by_covariance) = (similarity * b1 * over, a1 * over);
            // Through the means, then through the variance and the covariance, which are taken about them.
            *by_mean = 2.0 * ((mx * similarity * b2 - my * a2) * over - (x * by_variance - y * by_covariance));
            *by_square = by_variance;
            *by_product = -2.0 * by_covariance;
        }
        for (from, into) in self.derivatives.chunks_exact(stride).zip(into.chunks_exact_mut(stride)) {
            self.padded.fill(0.0);
            self.padded[RADIUS * CHANNELS..][..values.len()].copy_from_slice(&from[..values.len()]);
            blur_row(taps, &self.padded, into);
        }
        sum(values)
    }

    #[inline(always)]
    fn gradient(
        &mut self,
        taps: &[f32; TAPS],
        window: [&[f32]; TAPS],
        render: &[f32],
        truth: &[f32],
        into: &mut [f32],
    ) {
        weighted_sum(taps, window, &mut self.derivatives);
        let (mean, rest) = self.derivatives.split_at(self.stride);
        let (square, product) = rest.split_at(self.stride);
        let derivatives = mean.iter().zip(square.iter().zip(product));
        for ((slot, (x, y)), (mean, (square, product))) in
            into.iter_mut().zip(render.iter().zip(truth)).zip(derivatives)
        {
            *slot = mean + (2.0 * (x - GREY) * square + (y - GREY) * product);
        }
    }
}

/// Twice a covariance, and the sum of the two variances, within what they can be except for [`ROUNDING`]: the sum is not negative,
/// and bounds the other. Equal values stay equal, and NaN stays NaN.
#[inline(always)]
fn restricted(covariance: f32, variance: f32) -> (f32, f32) {
    let variance = if variance < -ROUNDING { -ROUNDING } else { variance };
    let most = variance + 2.0 * ROUNDING;
    let covariance = if covariance > most { most } else { covariance };
    (if covariance < -most { -most } else { covariance }, variance)
}

/// Blurs a row, given with [`RADIUS`] pixels at each end.
#[inline(always)]
fn blur_row(taps: &[f32; TAPS], padded: &[f32], into: &mut [f32]) {
    let mut shifted: [&[f32]; TAPS] = [&[]; TAPS];
    for (tap, slot) in shifted.iter_mut().enumerate() {
        *slot = &padded[tap * CHANNELS..][..into.len()];
    }
    weighted_sum(taps, shifted, into);
}

/// `Σ taps[k] · rows[k]` for symmetric taps; all rows have a multiple of [`LANES`] values.
#[inline(always)]
fn weighted_sum(taps: &[f32; TAPS], rows: [&[f32]; TAPS], into: &mut [f32]) {
    let into = into.as_chunks_mut::<LANES>().0;
    let mut vectors: [&[[f32; LANES]]; TAPS] = [&[]; TAPS];
    for (slot, row) in vectors.iter_mut().zip(rows) {
        *slot = &row.as_chunks().0[..into.len()];
    }
    for (at, slot) in into.iter_mut().enumerate() {
        let mut sum = vectors[RADIUS][at];
        for value in &mut sum {
            *value *= taps[RADIUS];
        }
        for tap in 0..RADIUS {
            let (before, after) = (&vectors[tap][at], &vectors[TAPS - 1 - tap][at]);
            for ((sum, before), after) in sum.iter_mut().zip(before).zip(after) {
                *sum += taps[tap] * (before + after);
            }
        }
        *slot = sum;
    }
}

/// Sums in f64, in an order that suits vectors.
#[inline(always)]
fn sum(values: &[f32]) -> f64 {
    let (vectors, rest) = values.as_chunks::<LANES>();
    let mut sums = [0.0; LANES];
    for vector in vectors {
        for (sum, value) in sums.iter_mut().zip(vector) {
            *sum += f64::from(*value);
        }
    }
    sums.into_iter().sum::<f64>() + rest.iter().map(|value| f64::from(*value)).sum::<f64>()
}

#[cfg(test)]
mod tests {
    use atsplat_numeric::{Extremes as _, Tolerance};
    use atsplat_pixels::Image;
    use atsplat_tests::on_threads;

    use super::*;
    use crate::{Pair, Ssim, Values, ssim, ssim_map};

    const SIZE: [usize; 2] = [37, 23];
    /// A few roundings of f32 of the squares, over the least variance, `C2`.
    const F32: Tolerance = Tolerance { absolute: 1e-4, relative: 0.0 };

    /// Noise of this amplitude around a level; bright and flat is where variances lose most digits.
    fn images(level: f32, amplitude: f64) -> [Vec<f32>; 2] {
        [1, 2].map(|seed| {
            let noise = crate::learned::uniform(seed, SIZE[0] * SIZE[1] * CHANNELS, amplitude);
            noise.into_iter().enumerate().map(|(at, value)| level + 1e-4 * at as f32 % 0.1 + value).collect()
        })
    }

    fn image(samples: &[f32]) -> Image {
        let [width, height] = SIZE.map(|side| u32::try_from(side).unwrap());
        Image::new(width, height, samples.to_vec()).unwrap()
    }

    #[test]
    fn agrees_with_the_metric_in_f64() {
        for (level, amplitude) in [(0.5, 0.5), (0.9, 0.01), (0.05, 0.02)] {
            let [render, truth] = images(level, amplitude);
            let mut loss = DSsim::default();
            let sum = loss.evaluate(&render, &truth, SIZE, &mut Vec::new());
            let (a, b) = (image(&render), image(&truth));
            let pair = Pair::new(&a, &b).unwrap();
            let mean = sum / render.len() as f64;
            F32.assert([1.0 - mean], [ssim(&pair, Values::AsRendered, Ssim::INRIA).unwrap()], "SSIM");
            let map = ssim_map(&pair, Values::AsRendered, Ssim::INRIA).unwrap();
            let found =
                loss.values().as_chunks::<3>().0.iter().map(|rgb| 1.0 - rgb.map(f64::from).iter().sum::<f64>() / 3.0);
            F32.assert(found, map.iter().copied(), "map");
        }
    }

    #[test]
    fn gradient_agrees_with_differences_of_the_metric_in_f64() {
        let [render, truth] = images(0.6, 0.3);
        let (mut loss, mut gradient) = (DSsim::default(), Vec::new());
        // Twice, because buffers are reused.
        for _ in 0..2 {
            loss.evaluate(&render, &truth, SIZE, &mut gradient);
        }
        let truth = image(&truth);
        let total = |at: usize, change: f32| {
            let mut render = render.clone();
            render[at] += change;
            let render = image(&render);
            let pair = Pair::new(&render, &truth).unwrap();
            (1.0 - ssim(&pair, Values::AsRendered, Ssim::INRIA).unwrap()) * gradient.len() as f64
        };
        let step = 1.0 / 1024.0;
        let close = Tolerance::of_largest(2e-3, gradient.iter().copied().map(f64::from));
        let last = render.len() - 1;
        for at in [0, 1, 3 * SIZE[0] - 1, 5 * 3 * SIZE[0] + 17, 12 * 3 * SIZE[0] + 50, last - 40, last] {
            let slope = (total(at, step) - total(at, -step)) / (2.0 * f64::from(step));
            close.assert([f64::from(gradient[at])], [slope], &format!("value {at}"));
        }
    }

    /// One row of the gradient has its largest value.
    #[test]
    fn far_brighter_than_white_it_still_agrees_with_the_metric_in_f64() {
        const ROW: usize = 10;
        let row = SIZE[0] * CHANNELS;
        let render: Vec<f32> = (0..row * SIZE[1]).map(|at| 80.0 + 1e-4 * (at / CHANNELS % SIZE[0]) as f32).collect();
        let truth: Vec<f32> = (0..render.len()).map(|at| 0.6 + 0.1 * (at % CHANNELS) as f32).collect();
        let (mut loss, mut gradient) = (DSsim::default(), Vec::new());
        let mean = loss.evaluate(&render, &truth, SIZE, &mut gradient) / render.len() as f64;

        let (bright, truth) = (image(&render), image(&truth));
        let pair = Pair::new(&bright, &truth).unwrap();
        let exact = ssim(&pair, Values::AsRendered, Ssim::INRIA).unwrap();
        Tolerance::absolute(3e-3).assert([1.0 - mean], [exact], "SSIM");
        let map = ssim_map(&pair, Values::AsRendered, Ssim::INRIA).unwrap();
        let found =
            loss.values().as_chunks::<3>().0.iter().map(|rgb| 1.0 - rgb.map(f64::from).iter().sum::<f64>() / 3.0);
        Tolerance::absolute(0.02).assert(found, map.iter().copied(), "map");

        let total = |at: usize, change: f32| {
            let mut render = render.clone();
            render[at] += change;
            let render = image(&render);
            let pair = Pair::new(&render, &truth).unwrap();
            -ssim(&pair, Values::AsRendered, Ssim::INRIA).unwrap() * gradient.len() as f64
        };
        let step = 1.0 / 1024.0;
        let slope = |at: usize| (total(at, step) - total(at, -step)) / (2.0 * f64::from(step));
        let larger = |most: f64, value: f64| most.maximum_of(value.abs());
        let expected = (ROW * row..(ROW + 1) * row).map(slope).fold(0.0, larger);
        let found = gradient.iter().copied().map(f64::from).fold(0.0, larger);
        assert!((0.5 * expected..2.0 * expected).contains(&found), "largest gradient: {found:e} for {expected:e}");
    }

    /// Rows that one of the images lacks would keep what the last images left of them.
    #[test]
    #[should_panic(expected = "values of two images of 37×23 pixels")]
    fn images_of_other_sizes_are_rejected() {
        let [render, truth] = images(0.5, 0.4);
        let mut loss = DSsim::default();
        loss.evaluate(&render, &truth, SIZE, &mut Vec::new());
        loss.evaluate(&render, &truth[SIZE[0] * CHANNELS..], SIZE, &mut Vec::new());
    }

    #[test]
    fn only_what_no_images_have_is_restricted() {
        let bits = |(a, b): (f32, f32)| [a.to_bits(), b.to_bits()];
        // Covariance and variance, also such as rounding makes of images in [0, 1].
        for possible in [(0.0, 0.0), (0.3, 0.4), (-0.4, 0.4), (1.2e-6, -3e-7), (-7e-7, -3e-7), (-1e-6, -1e-6)] {
            assert_eq!(bits(restricted(possible.0, possible.1)), bits(possible), "{possible:?}");
        }
        // Equal images, whose loss is 0.
        assert_eq!(bits(restricted(-0.3, -0.3)), bits((-ROUNDING, -ROUNDING)));
        let most = 0.1 + 2.0 * ROUNDING;
        assert_eq!(bits(restricted(0.2, 0.1)), bits((most, 0.1)));
        assert_eq!(bits(restricted(-0.3, 0.1)), bits((-most, 0.1)));
        assert!(restricted(f32::NAN, 0.1).0.is_nan() && restricted(0.1, f32::NAN).1.is_nan(), "NaN is not hidden");
    }

    #[test]
    fn same_bits_on_any_number_of_threads() {
        let [render, truth] = images(0.5, 0.4);
        let evaluated = || {
            let (mut loss, mut gradient) = (DSsim::default(), Vec::new());
            let sum = loss.evaluate(&render, &truth, SIZE, &mut gradient);
            (sum.to_bits(), gradient, loss.values)
        };
        assert_eq!(on_threads(1, evaluated), on_threads(3, evaluated));
    }
}
