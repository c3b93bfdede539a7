use plotters::style::RGBColor;

/// Okabe and Ito's palette, distinguishable by colour-blind readers.
pub const COLOURS: [RGBColor; 6] = [
    RGBColor(0, 114, 178),
    RGBColor(213, 94, 0),
    RGBColor(0, 158, 115),
    RGBColor(204, 121, 167),
    RGBColor(230, 159, 0),
    RGBColor(86, 180, 233),
];

/// Neutral data: published values, values outside every bin.
pub const GREY: RGBColor = RGBColor(150, 150, 150);
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

/// The colour of a series; colours repeat after six.
pub fn colour(series: usize) -> RGBColor {
    COLOURS[series % COLOURS.len()]
}
