use plotters::style::RGBColor;

/// Okabe and Ito's colours, told apart by colour-blind readers.
pub const COLOURS: [RGBColor; 6] = [
    RGBColor(0, 114, 178),
    RGBColor(213, 94, 0),
    RGBColor(0, 158, 115),
    RGBColor(204, 121, 167),
    RGBColor(230, 159, 0),
    RGBColor(86, 180, 233),
];

/// What belongs to none of them: published values, what is outside every bin.
pub const GREY: RGBColor = RGBColor(150, 150, 150);
/// What plots are drawn on.
pub(crate) const SURFACE: RGBColor = RGBColor(255, 255, 255);
/// Text.
pub(crate) const INK: RGBColor = RGBColor(31, 35, 40);
/// Text on a light colour, which stays dark on a dark page.
pub(crate) const ON_LIGHT: RGBColor = RGBColor(20, 20, 20);
/// Axes and what is said in passing.
pub(crate) const MUTED: RGBColor = RGBColor(89, 99, 110);
/// Lines of a grid.
pub(crate) const GRID: RGBColor = RGBColor(228, 231, 235);

/// The colour of a series; they repeat after six.
pub fn colour(series: usize) -> RGBColor {
    COLOURS.get(series % COLOURS.len()).copied().unwrap_or(GREY)
}
