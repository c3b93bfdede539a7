use plotters::style::RGBColor;

/// Okabe and Ito's palette without black and yellow, and four more colours chosen so that all ten differ for readers with
/// normal vision, protanopia, deuteranopia and tritanopia, and from the page in its light and dark theme.
pub const COLOURS: [RGBColor; 10] = [
    RGBColor(0, 114, 178),
    RGBColor(213, 94, 0),
    RGBColor(0, 158, 115),
    RGBColor(204, 121, 167),
    RGBColor(230, 159, 0),
    RGBColor(86, 180, 233),
    RGBColor(128, 0, 240),
    RGBColor(208, 208, 128),
    RGBColor(128, 48, 16),
    RGBColor(112, 48, 96),
];

/// Neutral data: published values, values outside every bin.
pub const GREY: RGBColor = RGBColor(118, 118, 118);
/// Background.
pub(crate) const SURFACE: RGBColor = RGBColor(255, 255, 255);
/// Text.
pub(crate) const INK: RGBColor = RGBColor(31, 35, 40);
/// Text on a light colour, which stays dark in the page's dark theme.
pub(crate) const ON_LIGHT: RGBColor = RGBColor(20, 20, 20);
/// Axes and secondary text.
pub(crate) const MUTED: RGBColor = RGBColor(89, 99, 110);
/// Grid lines.
pub(crate) const GRID: RGBColor = RGBColor(228, 231, 235);

/// Font sizes in CSS pixels: of titles, of names, and of everything else.
pub(crate) const TITLE: f64 = 17.0;
pub(crate) const NAME: f64 = 13.0;
pub(crate) const SMALL: f64 = 12.0;

/// The colour of a series. After ten colours come darker shades of them, and after these lighter ones, so that thirty series
/// have different colours.
pub fn colour(series: usize) -> RGBColor {
    let RGBColor(r, g, b) = COLOURS[series % COLOURS.len()];
    let towards = |end: u16| {
        let mixed = |level: u8| u8::try_from((u16::from(level) * 6 + end * 4) / 10).unwrap_or(u8::MAX);
        RGBColor(mixed(r), mixed(g), mixed(b))
    };
    match series / COLOURS.len() % 3 {
        0 => RGBColor(r, g, b),
        1 => towards(0),
        _ => towards(255),
    }
}

/// Text that is readable on a colour.
pub(crate) fn text_on(colour: RGBColor) -> RGBColor {
    let RGBColor(r, g, b) = colour;
    let luma = 0.299 * f64::from(r) + 0.587 * f64::from(g) + 0.114 * f64::from(b);
    if luma > 125.0 { ON_LIGHT } else { SURFACE }
}

#[cfg(test)]
mod tests {
    use atsplat_numeric::Extremes as _;

    use super::*;

    /// What a reader without the cones for long, medium or short waves sees of linear light (Machado et al. 2009,
    /// severity 1), and normal vision.
    const SIGHT: [[[f64; 3]; 3]; 4] = [
        [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
        [[0.152_286, 1.052_583, -0.204_868], [0.114_503, 0.786_281, 0.099_216], [-0.003_882, -0.048_116, 1.051_998]],
        [[0.367_322, 0.860_646, -0.227_968], [0.280_085, 0.672_501, 0.047_413], [-0.011_820, 0.042_940, 0.968_881]],
        [[1.255_528, -0.076_749, -0.178_779], [-0.078_411, 0.930_809, 0.147_602], [0.004_733, 0.691_367, 0.303_900]],
    ];
    const XYZ: [[f64; 3]; 3] =
        [[0.412_456, 0.357_576, 0.180_438], [0.212_673, 0.715_152, 0.072_175], [0.019_334, 0.119_192, 0.950_304]];

    fn times(matrix: [[f64; 3]; 3], vector: [f64; 3]) -> [f64; 3] {
        matrix.map(|row| row.iter().zip(vector).map(|(a, b)| a * b).sum())
    }

    /// CIE L*a*b* of a colour as a reader sees it.
    fn lab(RGBColor(r, g, b): RGBColor, sight: [[f64; 3]; 3]) -> [f64; 3] {
        let linear = [r, g, b].map(|value| {
            let value = f64::from(value) / 255.0;
            if value <= 0.040_45 { value / 12.92 } else { ((value + 0.055) / 1.055).powf(2.4) }
        });
        let white = times(XYZ, [1.0; 3]);
        let seen = times(XYZ, times(sight, linear).map(|value| value.clamp(0.0, 1.0)));
        let root = |at: usize| {
            let share = seen[at] / white[at];
            if share > 0.008_856 { share.cbrt() } else { 7.787 * share + 16.0 / 116.0 }
        };
        [116.0 * root(1) - 16.0, 500.0 * (root(0) - root(1)), 200.0 * (root(1) - root(2))]
    }

    /// The least distance of two colours in the eyes of all readers.
    fn distance(a: RGBColor, b: RGBColor) -> f64 {
        let seen_with = |sight| {
            let pairs = lab(a, sight).into_iter().zip(lab(b, sight));
            pairs.map(|(a, b)| (a - b) * (a - b)).sum::<f64>().sqrt()
        };
        SIGHT.into_iter().map(seen_with).fold(f64::INFINITY, f64::minimum_of)
    }

    #[test]
    fn colour_blind_readers_can_tell_the_colours_apart() {
        assert!(distance(RGBColor(200, 80, 60), RGBColor(110, 120, 60)) < 16.0, "red and green look the same to some");
        for (at, one) in COLOURS.iter().enumerate() {
            assert!(distance(*one, GREY) > 10.0, "{one:?} and grey: {}", distance(*one, GREY));
            for other in &COLOURS[at + 1..] {
                assert!(distance(*one, *other) > 16.0, "{one:?} and {other:?}: {}", distance(*one, *other));
            }
        }
    }

    #[test]
    fn thirty_series_have_different_colours() {
        for at in 0..30 {
            assert!((0..at).all(|other| colour(other) != colour(at)), "series {at}");
        }
    }
}
