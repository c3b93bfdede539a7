use rayon::prelude::*;

use super::LpipsNetwork;
use super::matrix::Activations;

/// Features of an image: five maps, normalised over the channels of each pixel.
#[derive(Clone, Debug, PartialEq)]
pub struct Features {
    pub(super) network: LpipsNetwork,
    /// Hash of the network's weights.
    pub(super) weights: String,
    /// Width and height of the image.
    pub(super) image: [u32; 2],
    pub(super) maps: Vec<Activations>,
}

impl Features {
    /// Size of all maps in bytes.
    pub fn bytes(&self) -> usize {
        self.maps.iter().map(|map| map.values.len() * size_of::<f32>()).sum()
    }
}

/// Divides a pixel's channels by their Euclidean norm plus 1e-10 (lpips `normalize_tensor`).
pub(super) fn normalised(mut map: Activations) -> Activations {
    let (channels, row) = (map.channels, map.row());
    map.values.par_chunks_mut(row.max(1)).for_each(|row| {
        for pixel in row.chunks_exact_mut(channels) {
            let norm = sum_of_squares(pixel).sqrt() + 1e-10;
            for value in pixel {
                *value /= norm;
            }
        }
    });
    map
}

/// `Σ weights · (a − b)²` of every pixel, row-major.
pub(super) fn distances(a: &Activations, b: &Activations, weights: &[f32]) -> Vec<f64> {
    let pixels = a.values.par_chunks_exact(a.channels).zip(b.values.par_chunks_exact(a.channels));
    pixels.with_min_len(256).map(|(a, b)| weighted(a, b, weights)).collect()
}

const LANES: usize = 16;

fn sum_of_squares(values: &[f32]) -> f32 {
    let (chunks, rest) = values.as_chunks::<LANES>();
    let mut lanes = [0.0f32; LANES];
    for chunk in chunks {
        for (lane, value) in lanes.iter_mut().zip(chunk) {
            *lane += value * value;
        }
    }
    lanes.iter().sum::<f32>() + rest.iter().map(|value| value * value).sum::<f32>()
}

fn weighted(a: &[f32], b: &[f32], weights: &[f32]) -> f64 {
    let (a, b, weights) = (a.as_chunks::<LANES>().0, b.as_chunks::<LANES>().0, weights.as_chunks::<LANES>().0);
    let mut lanes = [0.0f32; LANES];
    for ((a, b), weights) in a.iter().zip(b).zip(weights) {
        for lane in 0..LANES {
            let difference = a[lane] - b[lane];
            lanes[lane] += weights[lane] * (difference * difference);
        }
    }
    lanes.iter().map(|lane| f64::from(*lane)).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_sample_takes_four_bytes() {
        let map =
            |side: usize| Activations { height: side, width: side, channels: 5, values: vec![0.0; side * side * 5] };
        let (network, weights, maps) = (LpipsNetwork::LpipsAlex, String::new(), vec![map(3), map(1)]);
        assert_eq!(Features { network, weights, image: [3, 3], maps }.bytes(), 4 * (45 + 5));
    }
}
