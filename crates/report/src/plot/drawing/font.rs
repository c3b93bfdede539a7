use std::collections::BTreeSet;
use std::sync::OnceLock;

use ab_glyph::{Font as _, FontRef};
use plotters::style::{FontDesc, FontFamily, FontStyle, register_font};

use crate::ReportError;

/// The name under which the bundled font is registered.
pub(in crate::plot) const FONT: &str = "atsplat";

/// Font families of SVGs: the bundled font if it is installed, otherwise one with equal widths.
pub(in crate::plot) const FAMILIES: &str = "DejaVu Sans, Bitstream Vera Sans, Verdana, sans-serif";

/// In bitmaps, plotters measures font sizes from ascender to descender, 1901 and 483 of an em's 2048 units in `DejaVu`.
pub(in crate::plot) const PIXELS_PER_CSS: f64 = 2384.0 / 2048.0;

/// Registers the bundled `DejaVu` Sans, the only font available to plotters without a system font library.
///
/// # Errors
/// [`ReportError::Font`] if it cannot be read.
pub(in crate::plot) fn register_fonts() -> Result<(), ReportError> {
    static OUTCOME: OnceLock<bool> = OnceLock::new();
    let registered = *OUTCOME.get_or_init(|| {
        register_font(FONT, FontStyle::Normal, dejavu::sans::regular()).is_ok()
            && register_font(FONT, FontStyle::Bold, dejavu::sans::bold()).is_ok()
    });
    if registered { Ok(()) } else { Err(ReportError::Font) }
}

/// Width of a text in CSS pixels; an estimate if the font cannot be read, because encoding then fails anyway with
/// [`ReportError::Font`].
pub(in crate::plot) fn width_of(text: &str, size: f64, bold: bool) -> f64 {
    let style = if bold { FontStyle::Bold } else { FontStyle::Normal };
    // Ten times as large, because plotters measures in whole pixels.
    let font = FontDesc::new(FontFamily::Name(FONT), size * PIXELS_PER_CSS * 10.0, style);
    let measured = register_fonts().ok().and_then(|()| font.layout_box(text).ok());
    measured.map_or(0.62 * size * text.chars().count() as f64, |((left, _), (right, _))| f64::from(right - left) / 10.0)
}

/// The characters of a text that the bundled font lacks: bitmaps have a box in their place, and SVGs the glyph of another font.
pub(in crate::plot) fn without_glyph(text: &str, bold: bool) -> BTreeSet<char> {
    static FACES: OnceLock<[Option<FontRef<'static>>; 2]> = OnceLock::new();
    let read = || [dejavu::sans::regular(), dejavu::sans::bold()].map(|bytes| FontRef::try_from_slice(bytes).ok());
    let [plain, heavy] = FACES.get_or_init(read);
    let face = if bold { heavy } else { plain };
    let Some(face) = face else { return BTreeSet::new() };
    text.chars().filter(|letter| !letter.is_control() && face.glyph_id(*letter).0 == 0).collect()
}

/// The text in lines of at most this width, broken at spaces; a word that is too wide is broken between its letters.
pub(in crate::plot) fn wrapped(text: &str, size: f64, bold: bool, room: f64) -> Vec<String> {
    let fits = |text: &str| !room.is_finite() || width_of(text, size, bold) <= room;
    let mut lines = vec![String::new()];
    for word in text.split(' ') {
        let Some(line) = lines.last_mut() else { continue };
        let longer = if line.is_empty() { word.to_owned() } else { format!("{line} {word}") };
        if fits(&longer) {
            *line = longer;
            continue;
        }
        if !line.is_empty() {
            lines.push(String::new());
        }
        for letter in word.chars() {
            let Some(line) = lines.last_mut() else { continue };
            line.push(letter);
            if line.chars().count() > 1 && !fits(line) {
                line.pop();
                lines.push(letter.to_string());
            }
        }
    }
    lines
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
    fn characters_without_a_glyph_are_found() {
        let texts = ["ATSplat–λ, σ ≥ ½ ‡ § “µ”\u{1b}", "模型 A, 模 B"];
        for bold in [false, true] {
            let absent = texts.map(|text| without_glyph(text, bold).into_iter().collect::<String>());
            assert_eq!(absent, ["", "型模"]);
        }
    }

    #[test]
    fn long_texts_are_broken_at_spaces_and_keep_every_letter() {
        let text = "a very long name of a scene with averyveryverylongword in it";
        let lines = wrapped(text, 13.0, false, 80.0);
        assert!(lines.len() > 4 && lines.iter().all(|line| width_of(line, 13.0, false) <= 80.0), "{lines:?}");
        assert_eq!(lines[0], "a very long");
        assert_eq!(lines.concat().replace(' ', ""), text.replace(' ', ""));
        assert_eq!(wrapped("short", 13.0, false, 80.0), ["short"]);
        assert_eq!(wrapped("xy", 13.0, false, 0.0), ["x", "y"]);
    }
}
