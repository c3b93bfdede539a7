//! How different colours look to readers with normal and with other colour vision.

use atsplat_numeric::Extremes as _;
use atsplat_pixels::Srgb as _;
use plotters::style::RGBColor;

/// What a reader without the cones for long, medium or short waves sees of linear light (Machado et al. 2009, severity 1), after
/// normal vision.
const SIGHT: [[[f64; 3]; 3]; 4] = [
    [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
    [[0.152_286, 1.052_583, -0.204_868], [0.114_503, 0.786_281, 0.099_216], [-0.003_882, -0.048_116, 1.051_998]],
    [[0.367_322, 0.860_646, -0.227_968], [0.280_085, 0.672_501, 0.047_413], [-0.011_820, 0.042_940, 0.968_881]],
    [[1.255_528, -0.076_749, -0.178_779], [-0.078_411, 0.930_809, 0.147_602], [0.004_733, 0.691_367, 0.303_900]],
];
const XYZ: [[f64; 3]; 3] =
    [[0.412_456, 0.357_576, 0.180_438], [0.212_673, 0.715_152, 0.072_175], [0.019_334, 0.119_192, 0.950_304]];
/// White in [`XYZ`]: the sums of its rows.
const WHITE: [f64; 3] = [0.950_47, 1.0, 1.088_83];

/// The least distance of two colours in the eyes of all readers, in CIE L*a*b*.
pub(super) fn distance(a: RGBColor, b: RGBColor) -> f64 {
    let seen_with = |sight| {
        let pairs = lab(a, sight).into_iter().zip(lab(b, sight));
        pairs.map(|(a, b)| (a - b) * (a - b)).sum::<f64>().sqrt()
    };
    SIGHT.into_iter().map(seen_with).fold(f64::INFINITY, f64::minimum_of)
}

/// CIE L*a*b* of a colour as a reader sees it.
fn lab(colour: RGBColor, sight: [[f64; 3]; 3]) -> [f64; 3] {
    let root = |share: f64| if share > 0.008_856 { share.cbrt() } else { 7.787 * share + 16.0 / 116.0 };
    let [x, y, z] = times(XYZ, times(sight, linear(colour)).map(|value| value.clamp(0.0, 1.0)));
    let [x, y, z] = [x / WHITE[0], y / WHITE[1], z / WHITE[2]].map(root);
    [116.0 * y - 16.0, 500.0 * (x - y), 200.0 * (y - z)]
}

/// The light of a colour's red, green and blue.
fn linear(RGBColor(r, g, b): RGBColor) -> [f64; 3] {
    [r, g, b].map(|value| (f64::from(value) / 255.0).linear_from_srgb())
}

fn times(matrix: [[f64; 3]; 3], vector: [f64; 3]) -> [f64; 3] {
    matrix.map(|row| row.iter().zip(vector).map(|(a, b)| a * b).sum())
}

/// The contrast of two colours, from 1 to 21 (WCAG 2).
#[cfg(test)]
pub(super) fn contrast(a: RGBColor, b: RGBColor) -> f64 {
    let [a, b] = [a, b].map(|colour| {
        let [_, luminance, _] = times(XYZ, linear(colour));
        luminance + 0.05
    });
    a.maximum_of(b) / a.minimum_of(b)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn colours_that_some_readers_confuse_are_close() {
        let [red, green] = [RGBColor(200, 80, 60), RGBColor(110, 120, 60)];
        assert!(distance(red, green) < 16.0, "{}", distance(red, green));
        let (black, white) = (RGBColor(0, 0, 0), RGBColor(255, 255, 255));
        assert!((distance(black, white) - 100.0).abs() < 0.1, "{}", distance(black, white));
        assert!((contrast(white, black) - 21.0).abs() < 0.01, "{}", contrast(white, black));
    }
}
