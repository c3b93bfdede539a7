use rayon::prelude::*;

use super::matrix::{Activations, Rows, multiply_add};

/// Approximate number of outputs per task; its number of rows depends on the image's width only.
const BAND_PIXELS: usize = 2048;

/// A convolution with its kernel rearranged for [`Activations`].
#[derive(Clone, Debug)]
pub(super) struct Convolution {
    kernel: usize,
    stride: usize,
    padding: usize,
    channels_in: usize,
    channels_out: usize,
    /// For each kernel row, a matrix from (kernel column, input channel) to output channel.
    kernel_rows: Vec<Vec<f32>>,
    bias: Vec<f32>,
}

impl Convolution {
    /// From PyTorch's layout: output channel, input channel, kernel row, kernel column. Lengths must match.
    pub(super) fn new(
        [channels_out, channels_in, kernel]: [usize; 3],
        stride: usize,
        padding: usize,
        weight: &[f32],
        bias: Vec<f32>,
    ) -> Self {
        let kernel_row = |y: usize| {
            let positions = (0..kernel).flat_map(|x| (0..channels_in).map(move |channel| (x, channel)));
            positions
                .flat_map(|(x, channel)| {
                    (0..channels_out).map(move |out| weight[((out * channels_in + channel) * kernel + y) * kernel + x])
                })
                .collect()
        };
        let kernel_rows = (0..kernel).map(kernel_row).collect();
        Self { kernel, stride, padding, channels_in, channels_out, kernel_rows, bias }
    }

    /// Output side for an input side; `None` if the kernel does not fit.
    pub(super) fn side(kernel: usize, stride: usize, padding: usize, side: usize) -> Option<usize> {
        (side + 2 * padding).checked_sub(kernel).map(|room| room / stride + 1)
    }

    /// The convolution with bias, optionally followed by `ReLU`. The input must be large enough for the kernel.
    ///
    /// No patches are copied: a kernel row reads contiguous pixels, and the rows of the left matrix overlap. With stride 1, a
    /// band of complete rows is one product per kernel row; the columns beyond the image are computed and dropped.
    #[expect(clippy::expect_used, reason = "images are at least as large as the network's smallest side")]
    pub(super) fn apply(&self, input: &Activations, relu: bool) -> Activations {
        let padded = input.padded(self.padding);
        let side =
            |side| Self::side(self.kernel, self.stride, self.padding, side).expect("an input as large as the kernel");
        let mut output = Activations::zeros(side(input.height), side(input.width), self.channels_out);
        let rows_per_band = BAND_PIXELS.div_ceil(padded.width.max(1));
        let band = (rows_per_band * output.row()).max(1);
        output.values.par_chunks_mut(band).enumerate().for_each(|(number, out)| {
            self.band(&padded, number * rows_per_band, out, relu);
        });
        output
    }

    fn band(&self, padded: &Activations, first: usize, out: &mut [f32], relu: bool) {
        let columns = (padded.width - self.kernel) / self.stride + 1;
        let rows = out.len() / (columns * self.channels_out);
        let (calls, positions) =
            if self.stride == 1 { (1, (rows - 1) * padded.width + columns) } else { (rows, columns) };
        let mut sums = vec![0.0; positions * self.channels_out];
        for call in 0..calls {
            for (position, sum) in sums.chunks_exact_mut(self.channels_out).enumerate() {
                debug_assert!(position < positions);
                sum.copy_from_slice(&self.bias);
            }
            for (kernel_row, right) in self.kernel_rows.iter().enumerate() {
                let start = (first + call) * self.stride + kernel_row;
                let data = &padded.values[start * padded.row()..];
                let left = Rows { data, count: positions, stride: self.stride * self.channels_in };
                multiply_add(&mut sums, left, right, self.kernel * self.channels_in, self.channels_out);
            }
            let row = columns * self.channels_out;
            let computed = sums.chunks(padded.width * self.channels_out);
            for (slot, computed) in out[call * row..].chunks_exact_mut(row).zip(computed) {
                slot.copy_from_slice(&computed[..row]);
            }
        }
        if relu {
            rectify(out);
        }
    }
}

/// The rectified linear unit; NaN stays NaN, as in PyTorch.
pub(super) fn rectify(values: &mut [f32]) {
    for value in values {
        *value = if *value <= 0.0 { 0.0 } else { *value };
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use atsplat_numeric::Tolerance;
    use proptest::prelude::*;

    /// The definition in f64.
    fn direct(convolution: [usize; 5], weight: &[f32], bias: &[f32], input: &Activations) -> Vec<f64> {
        let [channels_out, channels_in, kernel, stride, padding] = convolution;
        let side = |side| Convolution::side(kernel, stride, padding, side).unwrap();
        let mut out = Vec::new();
        for (y, x) in (0..side(input.height)).flat_map(|y| (0..side(input.width)).map(move |x| (y, x))) {
            for channel_out in 0..channels_out {
                let mut sum = f64::from(bias[channel_out]);
                for (ky, kx) in (0..kernel).flat_map(|ky| (0..kernel).map(move |kx| (ky, kx))) {
                    let (row, column) = (y * stride + ky, x * stride + kx);
                    let inside = row >= padding && column >= padding;
                    let (row, column) = (row.wrapping_sub(padding), column.wrapping_sub(padding));
                    if !inside || row >= input.height || column >= input.width {
                        continue;
                    }
                    for channel in 0..channels_in {
                        let value = input.values[(row * input.width + column) * channels_in + channel];
                        let weight = weight[((channel_out * channels_in + channel) * kernel + ky) * kernel + kx];
                        sum += f64::from(value) * f64::from(weight);
                    }
                }
                out.push(sum);
            }
        }
        out
    }

    fn numbers(count: usize, seed: u64) -> Vec<f32> {
        crate::learned::uniform(seed, count, 1.0)
    }

    #[test]
    fn rectifying_keeps_nan() {
        let input = Activations { height: 1, width: 4, channels: 1, values: vec![2.0, f32::NAN, -3.0, -0.0] };
        let found = Convolution::new([1, 1, 1], 1, 0, &[1.0], vec![0.0]).apply(&input, true);
        assert!(found.values[1].is_nan(), "{found:?}");
        let others = [0, 2, 3].map(|at| f64::from(found.values[at]));
        Tolerance::EXACT.assert(others, [2.0, 0.0, 0.0], "rectified");
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(64))]
        #[test]
        fn agrees_with_its_definition(
            kernel in prop::sample::select(vec![1usize, 3, 5, 11]),
            stride in 1usize..5,
            padding in 0usize..3,
            channels in (1usize..6, 1usize..9),
            size in (1usize..40, 1usize..90),
            seed: u64,
        ) {
            let shape = [channels.0, channels.1, kernel];
            prop_assume!(Convolution::side(kernel, stride, padding, size.0).is_some());
            prop_assume!(Convolution::side(kernel, stride, padding, size.1).is_some());
            let weight = numbers(channels.0 * channels.1 * kernel * kernel, seed);
            let bias = numbers(channels.0, seed ^ 1);
            let mut input = Activations::zeros(size.0, size.1, channels.1);
            input.values = numbers(input.values.len(), seed ^ 2);
            let expected = direct([shape[0], shape[1], kernel, stride, padding], &weight, &bias, &input);
            let found = Convolution::new(shape, stride, padding, &weight, bias).apply(&input, false);
            let outcome = Tolerance { absolute: 2e-5, relative: 1e-5 }
                .check(found.values.iter().copied().map(f64::from), expected);
            prop_assert!(outcome.is_ok(), "{outcome:?}");
        }
    }
}
