//! Gaussian blur of one picture with the window of SSIM: 11×11, standard deviation 1.5 pixels, black outside.

#![expect(
    clippy::inline_always,
    reason = "only code inlined into the dispatched function gets its vector instructions"
)]

const TAPS: usize = 11;
const RADIUS: usize = TAPS / 2;
const CHANNELS: usize = 3;

/// Blurs pictures of one size and reuses its buffers. The blur is its own adjoint.
#[derive(Debug)]
pub(super) struct Blur {
    taps: [f64; TAPS],
    height: usize,
    /// Values in a row.
    row: usize,
    padded: Vec<f64>,
    across: Vec<f64>,
}

impl Blur {
    pub(super) fn new(height: usize, width: usize) -> Self {
        let mut taps = [0.0; TAPS];
        for (tap, offset) in taps.iter_mut().zip(-5i8..=5) {
            *tap = (-0.5 * (f64::from(offset) / 1.5).powi(2)).exp();
        }
        let sum: f64 = taps.iter().sum();
        let row = width * CHANNELS;
        Self {
            taps: taps.map(|tap| tap / sum),
            height,
            row,
            padded: vec![0.0; row + 2 * RADIUS * CHANNELS],
            across: vec![0.0; row * (height + 2 * RADIUS)],
        }
    }

    /// Blurs rows into a buffer with black rows above and below, then columns.
    #[inline(always)]
    pub(super) fn run(&mut self, from: &[f64], into: &mut [f64]) {
        let Self { taps, row, padded, across, .. } = self;
        let row = (*row).max(1);
        for (line, blurred) in from.chunks_exact(row).zip(across.chunks_exact_mut(row).skip(RADIUS)) {
            padded[RADIUS * CHANNELS..][..row].copy_from_slice(line);
            weighted_sum(taps, std::array::from_fn(|tap| &padded[tap * CHANNELS..][..row]), blurred);
        }
        for (line, blurred) in into.chunks_exact_mut(row).take(self.height).enumerate() {
            weighted_sum(taps, std::array::from_fn(|tap| &across[(line + tap) * row..][..row]), blurred);
        }
    }
}

/// `Σ taps[k] · rows[k]` for symmetric taps.
#[inline(always)]
fn weighted_sum(taps: &[f64; TAPS], rows: [&[f64]; TAPS], into: &mut [f64]) {
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
