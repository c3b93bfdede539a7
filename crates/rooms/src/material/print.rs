use atsplat_numeric::Extremes;
use glam::{Vec2, Vec3};

use super::from_hsv;
use crate::noise::{edge, faded, fractal_noise, lattice, unit, visible};

/// A painting: a vertical gradient, ragged hills in front of it, and strokes and discs on top.
pub(super) fn painting(uv: Vec2, half: Vec2, footprint: f32, seed: u32) -> Vec3 {
    let size = half.x.minimum_of(half.y);
    let (p, footprint) = (uv / size, footprint / size);
    let pick = |what: i32, which: i32| unit(lattice(what, which, 6, seed));
    let hue = |which: i32| f64::from(pick(0, which));
    let colour = |which: i32| from_hsv(hue(which), 0.2 + 0.6 * hue(which + 20), 0.3 + 0.65 * hue(which + 40));
    let mut shown = colour(0).lerp(colour(1), (0.5 + 0.5 * p.y).clamp(0.0, 1.0));
    for hill in 0..3i16 {
        let at = Vec3::new(p.x * 1.7, f32::from(hill) * 9.1, pick(1, 0) * 50.0);
        let height = 0.5 - 0.45 * f32::from(hill) + 0.8 * fractal_noise(at, 6, footprint, seed);
        shown = shown.lerp(colour(2 + i32::from(hill)), edge(height - p.y, footprint));
    }
    let strokes = 4 + lattice(1, 1, 7, seed) % 9;
    for stroke in 0..strokes.cast_signed() {
        let centre = Vec2::new(pick(2, stroke) - 0.5, pick(3, stroke) - 0.5) * 2.0 * half / size;
        let angle = pick(4, stroke) * 3.2;
        let along = Vec2::new(angle.cos(), angle.sin());
        let q = Vec2::new((p - centre).dot(along), (p - centre).dot(along.perp())).abs();
        let (radius, long) = (0.04 + 0.2 * pick(5, stroke), 0.3 * pick(6, stroke));
        let beyond = if q.x > long { q.x - long } else { 0.0 };
        let inside = radius - Vec2::new(beyond, q.y).length();
        shown = shown.lerp(colour(6 + stroke), 0.9 * edge(inside, footprint));
    }
    let canvas = fractal_noise((p * 40.0).extend(0.5), 2, footprint * 40.0, seed);
    shown * (1.0 + 0.25 * canvas)
}

/// Mean ink of the 40 glyphs with the space around them, and of words with their gaps.
const GLYPH_INK: f32 = 0.185;
const WORD_INK: f32 = GLYPH_INK * 5.0 / 6.0;

/// Ragged lines of invented glyphs with a headline; each glyph is one of 40 bitmaps of 4×6. Dots fade to glyphs, glyphs to
/// words, and lines to the whole page.
#[expect(clippy::cast_possible_truncation, reason = "a page has few glyphs")]
pub(super) fn text([ink, paper]: [Vec3; 2], uv: Vec2, half: Vec2, line: f32, footprint: f32, seed: u32) -> Vec3 {
    if uv.abs().cmpgt(half).any() {
        return paper;
    }
    let from_corner = Vec2::new(uv.x + half.x, half.y - uv.y) - Vec2::splat(0.7 * line);
    let width = 2.0 * half.x - 1.4 * line;
    // Lines fill three quarters of the width.
    let page_ink = 0.75 * WORD_INK * width * (2.0 * half.y - 1.4 * line) / (4.0 * half.x * half.y);
    let page_size = 20.0 * line;
    let headline = from_corner.y < 2.2 * line;
    let line = if headline { 2.0 * line } else { line };
    let row = (from_corner.y / line).floor();
    let column = (from_corner.x / (0.5 * line)).floor();
    let last_row = ((2.0 * half.y - 1.4 * line) / line).floor();
    let filled = 0.5 + 0.5 * unit(lattice(row as i32, 0, 8, seed));
    let outside = column < 0.0 || row < 0.0 || row >= last_row || (column + 1.0) * 0.5 * line > width * filled;
    let gap = lattice(column as i32, row as i32, 9, seed).is_multiple_of(6);
    let within = Vec2::new(from_corner.x / (0.5 * line) - column, from_corner.y / line - row);
    let glyph = (lattice(column as i32, row as i32, 10, seed) % 40).cast_signed();
    let dot = (within * Vec2::new(5.0, 9.0)).floor();
    let in_glyph = dot.x < 4.0 && (1.0..7.0).contains(&dot.y);
    let bits = lattice(glyph, dot.y as i32 / 2 + 8 * (dot.x as i32 / 2), 11, 99)
        | lattice(glyph, dot.x as i32, 12, 99) & lattice(glyph, dot.y as i32, 13, 99);
    let dark = in_glyph && bits.is_multiple_of(2);
    let in_word = if gap { 0.0 } else { faded(if dark { 1.0 } else { 0.0 }, GLYPH_INK, 0.1 * line, footprint) };
    let in_line = if outside { 0.0 } else { faded(in_word, WORD_INK, 0.5 * line, footprint) };
    paper.lerp(ink, faded(in_line, page_ink, page_size, footprint))
}

/// Spines of different widths and heights in front of a dark shelf, most with a title.
#[expect(clippy::cast_possible_truncation, reason = "a shelf has few books")]
pub(super) fn books(uv: Vec2, height: f32, footprint: f32, seed: u32) -> Vec3 {
    const SLOT: f32 = 0.045;
    let slot = (uv.x / SLOT).floor();
    let pick = |slot: f32, what: i32| unit(lattice(slot as i32, what, 14, seed));
    let border = |slot: f32| slot + 0.6 * (pick(slot, 0) - 0.5);
    let x = uv.x / SLOT;
    let book = if x < border(slot) {
        slot - 1.0
    } else if x >= border(slot + 1.0) {
        slot + 1.0
    } else {
        slot
    };
    let (left, right) = (border(book) * SLOT, border(book + 1.0) * SLOT);
    let up = uv.y + 0.5 * height;
    let top = height * (0.72 + 0.22 * pick(book, 1));
    let inside = (uv.x - left).minimum_of(right - uv.x).minimum_of(top - up) - 0.001;
    let colour = |what| {
        from_hsv(
            pick(book, what).into(),
            0.7 * f64::from(pick(book, what + 1)),
            0.25 + 0.7 * f64::from(pick(book, what + 2)),
        )
    };
    let across = ((uv.x - left) / (right - left) - 0.5).abs();
    let title = across < 0.22 && (0.3..0.75).contains(&(up / top)) && pick((up * 180.0).floor(), 9 + book as i32) > 0.4;
    let seen = visible(0.012, footprint);
    let spine = colour(2).lerp(colour(5), if title { 0.8 * seen } else { 0.15 * (1.0 - seen) });
    let sharp = Vec3::splat(0.02).lerp(spine, edge(inside, footprint));
    Vec3::new(0.16, 0.13, 0.11).lerp(sharp, visible(SLOT, footprint))
}
