use std::sync::OnceLock;

use plotters::style::{FontDesc, FontFamily, FontStyle, register_font};

use crate::ReportError;

/// The name under which the bundled font is registered.
pub const FONT: &str = "atsplat";

/// Font families of SVGs: the bundled font if it is installed, otherwise one with equal widths.
pub(super) const FAMILIES: &str = "DejaVu Sans, Bitstream Vera Sans, Verdana, sans-serif";

/// plotters divides font sizes by this in SVG.
pub(super) const SVG_PER_CSS: f64 = 1.24;
/// In bitmaps, plotters measures font sizes from ascender to descender, 1901 and 483 of an em's 2048 units in `DejaVu`.
pub(super) const PIXELS_PER_CSS: f64 = 2384.0 / 2048.0;

/// Registers the bundled `DejaVu` Sans, the only font available to plotters without a system font library.
///
/// # Errors
/// [`ReportError::Font`] if it cannot be read.
pub fn register_fonts() -> Result<(), ReportError> {
    static OUTCOME: OnceLock<bool> = OnceLock::new();
    let registered = *OUTCOME.get_or_init(|| {
        register_font(FONT, FontStyle::Normal, dejavu::sans::regular()).is_ok()
            && register_font(FONT, FontStyle::Bold, dejavu::sans::bold()).is_ok()
    });
    if registered { Ok(()) } else { Err(ReportError::Font) }
}

/// Width of a text in CSS pixels; an estimate if the font cannot be read, because encoding then fails anyway with
/// [`ReportError::Font`].
pub(super) fn width_of(text: &str, size: f64, bold: bool) -> f64 {
    let style = if bold { FontStyle::Bold } else { FontStyle::Normal };
    // Ten times as large, because plotters measures in whole pixels.
    let font = FontDesc::new(FontFamily::Name(FONT), size * PIXELS_PER_CSS * 10.0, style);
    let measured = register_fonts().ok().and_then(|()| font.layout_box(text).ok());
    measured.map_or(0.62 * size * text.chars().count() as f64, |((left, _), (right, _))| f64::from(right - left) / 10.0)
}

/// The text, truncated with an ellipsis if it is wider than `room`.
pub(super) fn shortened(text: &str, size: f64, bold: bool, room: f64) -> String {
    if width_of(text, size, bold) <= room {
        return text.to_owned();
    }
    let letters: Vec<char> = text.chars().collect();
    let cut = |count: usize| letters.iter().take(count).chain(['…'].iter()).collect::<String>();
    let fitting = (0..letters.len()).rev().map(cut).find(|text| width_of(text, size, bold) <= room);
    fitting.unwrap_or_else(|| "…".to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn text_widths_are_those_of_the_bundled_font() {
        // DejaVu Sans: an em of 2048 units, "M" advances 1767, "i" 569.
        let advance = |letters: usize, units: f64| letters as f64 * units / 2048.0 * 20.0;
        let wide = width_of(&"M".repeat(10), 20.0, false);
        assert!((wide - advance(10, 1767.0)).abs() < 2.0, "{wide}");
        assert!(width_of("iiiiiiiiii", 20.0, false) < wide / 2.0);
    }

    #[test]
    fn long_texts_are_truncated_with_an_ellipsis() {
        let text = shortened("a very long name of a scene", 13.0, false, 80.0);
        assert!(text.ends_with('…') && width_of(&text, 13.0, false) <= 80.0, "{text}");
        assert_eq!(shortened("short", 13.0, false, 80.0), "short");
        assert_eq!(shortened("x", 13.0, false, 0.0), "…");
    }
}
