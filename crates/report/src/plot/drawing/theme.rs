use plotters::style::RGBColor;

use super::sight::distance;

/// Okabe and Ito's palette without black and yellow, and four more colours chosen so that all ten differ for readers with
/// normal vision, protanopia, deuteranopia and tritanopia, and from the page in its light and dark theme.
pub const COLOURS: [RGBColor; 10] = [
    RGBColor(0, 114, 178),
    RGBColor(213, 94, 0),
    RGBColor(0, 158, 115),
    RGBColor(204, 121, 167),
    RGBColor(230, 159, 0),
    RGBColor(86, 180, 233),
    // The dark theme has a lighter one in its place.
    RGBColor(128, 0, 240),
    RGBColor(208, 208, 128),
    RGBColor(88, 112, 48),
    RGBColor(160, 72, 128),
];

/// The colours of further series: ten that differ almost as much from all before, and ten that can just be told apart.
const FURTHER: [RGBColor; 20] = [
    RGBColor(208, 16, 40),
    RGBColor(152, 48, 208),
    RGBColor(208, 8, 176),
    RGBColor(184, 112, 240),
    RGBColor(104, 160, 88),
    RGBColor(160, 168, 72),
    RGBColor(176, 208, 160),
    RGBColor(152, 224, 208),
    RGBColor(240, 208, 88),
    RGBColor(104, 224, 255),
    RGBColor(200, 64, 255),
    RGBColor(32, 120, 80),
    RGBColor(216, 32, 96),
    RGBColor(80, 144, 208),
    RGBColor(248, 72, 208),
    RGBColor(232, 120, 128),
    RGBColor(112, 184, 160),
    RGBColor(208, 168, 120),
    RGBColor(72, 216, 56),
    RGBColor(200, 176, 216),
];

/// Series with their own colour; those after them repeat these.
const SERIES: usize = COLOURS.len() + FURTHER.len();

/// The distance below which readers cannot tell two colours apart on small marks.
const ALIKE: f64 = 10.0;

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

/// The colour of a series.
pub fn colour(series: usize) -> RGBColor {
    match series % SERIES {
        at if at < COLOURS.len() => COLOURS[at],
        at => FURTHER[at - COLOURS.len()],
    }
}

/// Whether some readers cannot tell two colours apart.
pub(super) fn look_alike(a: RGBColor, b: RGBColor) -> bool {
    distance(a, b) < ALIKE
}

/// Whether it is the colour of a series or of neutral data.
pub(super) fn in_palette(wanted: RGBColor) -> bool {
    wanted == GREY || COLOURS.contains(&wanted) || FURTHER.contains(&wanted)
}

/// Text that is readable on a colour.
pub(crate) fn text_on(colour: RGBColor) -> RGBColor {
    let RGBColor(r, g, b) = colour;
    let luma = 0.299 * f64::from(r) + 0.587 * f64::from(g) + 0.114 * f64::from(b);
    if luma > 125.0 { ON_LIGHT } else { SURFACE }
}

#[cfg(test)]
mod tests {
    use super::super::sight::contrast;
    use super::*;

    /// What the page's dark theme puts in place of the palette's violet, and below plots.
    const DARK_VIOLET: RGBColor = RGBColor(112, 64, 248);
    const DARK_SURFACE: RGBColor = RGBColor(23, 27, 33);

    fn in_dark_theme(colour: RGBColor) -> RGBColor {
        if colour == COLOURS[6] { DARK_VIOLET } else { colour }
    }

    #[test]
    fn colour_blind_readers_can_tell_the_colours_apart() {
        let themes: [fn(RGBColor) -> RGBColor; 2] = [|colour| colour, in_dark_theme];
        for theme in themes {
            for at in 0..SERIES {
                let one = theme(colour(at));
                assert!(!look_alike(one, GREY), "{one:?} and grey: {}", distance(one, GREY));
                for before in 0..at {
                    let (other, least) = (theme(colour(before)), [16.0, 15.0, ALIKE][at / 10]);
                    let found = distance(one, other);
                    assert!(found > least, "series {before} and {at}, {other:?} and {one:?}: {found}");
                }
            }
        }
        assert_eq!(colour(SERIES), colour(0));
    }

    #[test]
    fn every_series_is_visible_in_both_themes() {
        let style = include_str!("../../page/style.css");
        assert_eq!(style.matches("--plot-violet: #7040f8").count(), 2, "in both rules of the dark theme");
        assert_eq!(style.matches("--plot-surface: #171b21").count(), 2);
        assert!(style.contains("svg [fill=\"#8000F0\"] { fill: var(--plot-violet); }"));
        for at in 0..SERIES {
            let (light, dark) = (contrast(colour(at), SURFACE), contrast(in_dark_theme(colour(at)), DARK_SURFACE));
            assert!(light > 1.3 && dark > 3.0, "series {at}: {light} and {dark}");
        }
    }
}
