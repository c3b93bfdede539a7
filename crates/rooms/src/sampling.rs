//! Where in a pixel and when its rays are traced.

use glam::DVec2;

/// One ray of a pixel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Sample {
    /// Position relative to the pixel's centre, in pixels: each coordinate in (−0.5, 0.5).
    pub place: DVec2,
    /// Time relative to the middle of the time that the shutter is open, as a share of it, in (−0.5, 0.5).
    pub time: f64,
}

/// Steps of Roberts' R2 sequence, for the place, and of the golden ratio, for the time.
const PLACE_STEPS: [f64; 2] = [0.754_877_666_246_692_8, 0.569_840_290_998_053_2];
const TIME_STEP: f64 = 0.618_033_988_749_894_9;

/// The samples of a pixel, for any number of them.
///
/// Divided into `count` equal intervals, each coordinate has one sample in the middle of each. So the samples' mean is exactly
/// the pixel's centre in the middle of the exposure. Which intervals go together follows low-discrepancy sequences, which spread
/// the samples over the pixel and keep time nearly independent of place.
pub(crate) fn samples(count: u32) -> Vec<Sample> {
    let [x, y, time] = [PLACE_STEPS[0], PLACE_STEPS[1], TIME_STEP].map(|step| interval_centres(count, step));
    x.into_iter().zip(y).zip(time).map(|((x, y), time)| Sample { place: DVec2::new(x, y), time }).collect()
}

/// The centres of `count` equal intervals of (−0.5, 0.5), in the order of the sequence `0.5 + (n + 0.5) · step`, modulo 1.
fn interval_centres(count: u32, step: f64) -> Vec<f64> {
    let value = |n: u32| (0.5 + (f64::from(n) + 0.5) * step).fract();
    let mut order: Vec<u32> = (0..count).collect();
    order.sort_by(|a, b| value(*a).total_cmp(&value(*b)));
    let mut centres = vec![0.0; order.len()];
    for (rank, n) in (0..count).zip(order) {
        centres[n as usize] = (f64::from(rank) + 0.5) / f64::from(count) - 0.5;
    }
    centres
}

#[cfg(test)]
mod tests {
    use atsplat_numeric::Tolerance;

    use super::*;

    #[test]
    fn samples_of_any_number_are_centred_and_fill_every_interval() {
        for count in (1..=33).chain([64, 100, 255, 256]) {
            let samples = samples(count);
            assert_eq!(samples.len(), count as usize);
            let coordinates: [fn(&Sample) -> f64; 3] = [|s| s.place.x, |s| s.place.y, |s| s.time];
            for coordinate in coordinates {
                let mut sorted: Vec<f64> = samples.iter().map(coordinate).collect();
                sorted.sort_by(f64::total_cmp);
                let expected = (0..count).map(|n| (f64::from(n) + 0.5) / f64::from(count) - 0.5);
                Tolerance::absolute(1e-12).assert(sorted, expected.collect::<Vec<_>>(), &format!("{count} samples"));
            }
        }
        assert_eq!(samples(1), [Sample { place: DVec2::ZERO, time: 0.0 }]);
    }

    /// Four samples are a rotated grid: no two share a row, a column or a quarter of the pixel.
    #[test]
    fn four_samples_are_a_rotated_grid_in_mixed_order_of_time() {
        let samples = samples(4);
        let eighths = |value: f64| value * 8.0;
        let places: Vec<[f64; 2]> = samples.iter().map(|s| s.place.to_array().map(eighths)).collect();
        Tolerance::EXACT.assert(places.concat(), [3.0, 1.0, 1.0, -3.0, -1.0, 3.0, -3.0, -1.0], "places");
        Tolerance::EXACT.assert(samples.iter().map(|s| eighths(s.time)), [3.0, -1.0, -3.0, 1.0], "times");
    }

    /// The correlation between time and place would make a moving edge sharper or softer than it is.
    #[test]
    fn time_hardly_depends_on_place() {
        for count in [4, 8, 16, 64, 256] {
            let samples = samples(count);
            let variance = samples.iter().map(|s| s.time * s.time).sum::<f64>();
            for (axis, what) in [DVec2::X, DVec2::Y].into_iter().zip(["x", "y"]) {
                let correlation = samples.iter().map(|s| s.time * s.place.dot(axis)).sum::<f64>() / variance;
                assert!(correlation.abs() < 0.45, "{what} of {count}: {correlation}");
            }
        }
    }
}
