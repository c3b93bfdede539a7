use atsplat_numeric::Extremes as _;
use rayon::prelude::*;

use super::matrix::Activations;

/// Max pooling without padding; the largest of a square with NaN is NaN, as in PyTorch.
pub(super) fn max_pool(input: &Activations, kernel: usize, stride: usize) -> Activations {
    let side = |side: usize| side.checked_sub(kernel).map_or(0, |room| room / stride + 1);
    let mut output = Activations::zeros(side(input.height), side(input.width), input.channels);
    let channels = input.channels;
    output.values.par_chunks_mut(output.width.max(1) * channels).enumerate().for_each(|(y, row)| {
        for (x, pixel) in row.chunks_exact_mut(channels).enumerate() {
            pixel.fill(f32::NEG_INFINITY);
            for (ky, kx) in (0..kernel).flat_map(|ky| (0..kernel).map(move |kx| (ky, kx))) {
                let start = ((y * stride + ky) * input.width + x * stride + kx) * channels;
                for (slot, value) in pixel.iter_mut().zip(&input.values[start..start + channels]) {
                    *slot = value.maximum_of(*slot);
                }
            }
        }
    });
    output
}

/// Reflection padding before the blur.
const REFLECTED: usize = 2;

/// Output side of the blur; `None` if the side is too small to reflect.
pub(super) fn blur_pooled_side(side: usize) -> Option<usize> {
    (side > REFLECTED).then(|| (side + 2 * REFLECTED - 3) / 2 + 1)
}

/// Blur pooling of Zhang 2019, with which ST-LPIPS was trained: (1 2 1)⊗(1 2 1) / 16 at every second pixel, with two
/// reflected pixels as padding. The input must be large enough to reflect.
#[expect(clippy::expect_used, reason = "images are at least as large as the network's smallest side")]
pub(super) fn blur_pool(input: &Activations) -> Activations {
    let side = |side: usize| blur_pooled_side(side).expect("a side that can be reflected");
    let mut output = Activations::zeros(side(input.height), side(input.width), input.channels);
    let channels = input.channels;
    output.values.par_chunks_mut(output.width.max(1) * channels).enumerate().for_each(|(y, row)| {
        for (x, pixel) in row.chunks_exact_mut(channels).enumerate() {
            for (ky, kx) in (0..3).flat_map(|ky| (0..3).map(move |kx| (ky, kx))) {
                let weight = [1.0, 2.0, 1.0][ky] * [1.0, 2.0, 1.0][kx] / 16.0;
                let from = reflected(2 * y + ky, input.height) * input.width + reflected(2 * x + kx, input.width);
                for (slot, value) in pixel.iter_mut().zip(&input.values[from * channels..(from + 1) * channels]) {
                    *slot += weight * value;
                }
            }
        }
    });
    output
}

/// The pixel at a position of the padded image, reflected without repeating the edge.
fn reflected(position: usize, side: usize) -> usize {
    let from_edge = position.abs_diff(REFLECTED);
    if from_edge < side { from_edge } else { 2 * (side - 1) - from_edge }
}

#[cfg(test)]
mod tests {
    use super::*;
    use atsplat_numeric::Tolerance;

    fn ramp(height: usize, width: usize) -> Activations {
        let values = (0u16..).map(f32::from).take(height * width).collect();
        Activations { height, width, channels: 1, values }
    }

    fn assert_values(found: &Activations, expected: &[f64]) {
        Tolerance::EXACT.assert(found.values.iter().copied().map(f64::from), expected.iter().copied(), "pooled");
    }

    #[test]
    fn max_pooling_uses_complete_squares() {
        assert_values(&max_pool(&ramp(5, 5), 2, 2), &[6.0, 8.0, 16.0, 18.0]);
        assert_values(&max_pool(&ramp(3, 4), 3, 1), &[10.0, 11.0]);
        assert!(max_pool(&ramp(2, 2), 3, 1).values.is_empty());
    }

    #[test]
    fn max_pooling_keeps_nan_wherever_it_is_in_a_square() {
        let values = vec![f32::NAN, 1.0, 5.0, 6.0, 1.0, 2.0, 2.0, 3.0, 7.0, f32::NAN, 4.0, 3.0];
        let pooled = max_pool(&Activations { height: 2, width: 6, channels: 1, values }, 2, 2);
        assert!(pooled.values[0].is_nan() && pooled.values[1].is_nan(), "{pooled:?}");
        Tolerance::EXACT.assert([f64::from(pooled.values[2])], [4.0], "the square without");
    }

    #[test]
    fn reflections_do_not_repeat_the_edge() {
        let positions: Vec<usize> = (0..8).map(|position| reflected(position, 4)).collect();
        assert_eq!(positions, [2, 1, 0, 1, 2, 3, 2, 1]);
    }

    #[test]
    fn blurring_keeps_constants_and_reflects_edges() {
        let flat = Activations { height: 4, width: 3, channels: 2, values: vec![0.75; 24] };
        let halved = blur_pool(&flat);
        assert_eq!([halved.height, halved.width], [3, 3]);
        assert_values(&halved, &[0.75; 18]);
        // A ramp of 0 to 7: the blur of each column is its own value, except at the reflected edges.
        let columns = Activations { values: [0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0].repeat(3), ..ramp(3, 8) };
        let mirrored = [1.0, 1.0, 3.0, 5.0, 6.5];
        assert_values(&blur_pool(&columns), &mirrored.repeat(3));
    }
}
