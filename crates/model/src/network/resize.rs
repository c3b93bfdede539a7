use rayon::prelude::*;

use crate::ImageSize;

/// Weights of one output sample: for the input sample `first` and its successors.
struct Taps {
    first: usize,
    weights: Vec<f32>,
}

/// Antialiased bilinear resizing of a row-major image of `channels` interleaved values, as PyTorch's
/// `interpolate(mode="bilinear", antialias=True, align_corners=False)`: a triangle filter as wide as the scale, cut off at
/// the border and normalised.
pub(super) fn resized(image: &[f32], from: ImageSize, to: ImageSize, channels: usize) -> Vec<f32> {
    if from == to {
        return image.to_vec();
    }
    let (rows, columns) = (taps(from.height, to.height), taps(from.width, to.width));
    let mut wide = vec![0.0; to.width * from.height * channels];
    let row_of = |width: usize| (width * channels).max(1);
    wide.par_chunks_mut(row_of(to.width)).zip(image.par_chunks(row_of(from.width))).for_each(|(out, row)| {
        for (pixel, taps) in out.chunks_exact_mut(channels).zip(&columns) {
            accumulate(pixel, taps, row, channels);
        }
    });
    let mut small = vec![0.0; to.width * to.height * channels];
    small.par_chunks_mut(row_of(to.width)).zip(&rows).for_each(|(out, taps)| {
        accumulate(out, taps, &wide, row_of(to.width));
    });
    small
}

/// Weighted sum of runs of `stride` values.
fn accumulate(out: &mut [f32], taps: &Taps, values: &[f32], stride: usize) {
    let runs = values.chunks_exact(stride).skip(taps.first);
    for (run, weight) in runs.zip(&taps.weights) {
        for (sum, value) in out.iter_mut().zip(run) {
            *sum += weight * value;
        }
    }
}

fn taps(from: usize, to: usize) -> Vec<Taps> {
    let scale = from as f64 / to as f64;
    let support = if scale > 1.0 { scale } else { 1.0 };
    (0..to)
        .map(|sample| {
            let centre = (sample as f64 + 0.5) * scale;
            #[expect(
                clippy::cast_possible_truncation,
                clippy::cast_sign_loss,
                reason = "not negative, and below `from`"
            )]
            let bounds = [centre - support + 0.5, centre + support + 0.5]
                .map(|bound| if bound > 0.0 { (bound as usize).min(from) } else { 0 });
            let weight = |input: usize| {
                let distance = ((input as f64 - centre + 0.5) / support).abs();
                if distance < 1.0 { 1.0 - distance } else { 0.0 }
            };
            let weights: Vec<f64> = (bounds[0]..bounds[1]).map(weight).collect();
            let sum: f64 = weights.iter().sum();
            #[expect(clippy::cast_possible_truncation, reason = "images are f32")]
            let weights = weights.iter().map(|weight| (weight / sum) as f32).collect();
            Taps { first: bounds[0], weights }
        })
        .collect()
}
