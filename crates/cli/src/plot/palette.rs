use plotters::style::RGBColor;

/// Okabe and Ito's colours, told apart by colour-blind readers.
pub(crate) const COLOURS: [RGBColor; 6] = [
    RGBColor(213, 94, 0),
    RGBColor(230, 159, 0),
    RGBColor(0, 114, 178),
    RGBColor(0, 158, 115),
    RGBColor(204, 121, 167),
    RGBColor(86, 180, 233),
];

/// What belongs to none of them.
pub(crate) const GREY: RGBColor = RGBColor(150, 150, 150);
