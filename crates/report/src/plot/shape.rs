use atsplat_pixels::ImageU8;
use plotters::style::RGBColor;

use super::font;
use super::theme::{INK, MUTED};

/// A drawing made of shapes, to be encoded as SVG or PNG.
///
/// Units are CSS pixels, +x right, +y down, with the origin in the upper left corner.
#[derive(Clone, Debug)]
pub struct Drawing {
    pub(super) width: u32,
    pub(super) height: u32,
    pub(super) shapes: Vec<Shape>,
}

/// An element of a drawing; later elements are above earlier ones.
#[derive(Clone, Debug)]
pub(super) enum Shape {
    Line { points: Vec<[f64; 2]>, stroke: Stroke },
    Disc { centre: [f64; 2], radius: f64, fill: Fill },
    Ring { centre: [f64; 2], radius: f64, stroke: Stroke },
    Area { corners: Vec<[f64; 2]>, fill: Fill },
    Text(TextLine),
    Picture { at: Extent, image: ImageU8 },
}

/// How a line is drawn.
#[derive(Clone, Copy, Debug)]
pub(super) struct Stroke {
    pub(super) colour: RGBColor,
    pub(super) width: f64,
}

/// How an area is filled; opacity in [0, 1].
#[derive(Clone, Copy, Debug)]
pub(super) struct Fill {
    pub(super) colour: RGBColor,
    pub(super) opacity: f64,
}

/// A line of text, vertically centred on `at` and horizontally aligned to it by `side`.
#[derive(Clone, Debug)]
pub(super) struct TextLine {
    pub(super) text: String,
    pub(super) at: [f64; 2],
    pub(super) size: f64,
    pub(super) bold: bool,
    pub(super) colour: RGBColor,
    pub(super) side: Side,
}

/// The part of a text that is aligned to its position.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Side {
    Left,
    Middle,
    Right,
}

/// A rectangle: left, top, right, bottom.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Extent {
    pub(super) left: f64,
    pub(super) top: f64,
    pub(super) right: f64,
    pub(super) bottom: f64,
}

impl Extent {
    pub(super) const fn new(left: f64, top: f64, right: f64, bottom: f64) -> Self {
        Self { left, top, right, bottom }
    }

    pub(super) fn width(self) -> f64 {
        self.right - self.left
    }

    pub(super) fn height(self) -> f64 {
        self.bottom - self.top
    }

    /// The area of the intersection, in square pixels.
    pub(super) fn shared(self, other: Self) -> f64 {
        let length = |low: f64, high: f64| (high - low).clamp(0.0, f64::INFINITY);
        let left = if self.left > other.left { self.left } else { other.left };
        let right = if self.right < other.right { self.right } else { other.right };
        let top = if self.top > other.top { self.top } else { other.top };
        let bottom = if self.bottom < other.bottom { self.bottom } else { other.bottom };
        length(left, right) * length(top, bottom)
    }

    pub(super) fn contains(self, other: Self) -> bool {
        self.left <= other.left && self.top <= other.top && other.right <= self.right && other.bottom <= self.bottom
    }
}

impl Stroke {
    pub(super) const fn new(colour: RGBColor, width: f64) -> Self {
        Self { colour, width }
    }
}

impl Fill {
    pub(super) const fn solid(colour: RGBColor) -> Self {
        Self { colour, opacity: 1.0 }
    }

    pub(super) const fn faint(colour: RGBColor, opacity: f64) -> Self {
        Self { colour, opacity }
    }
}

impl TextLine {
    /// Plain text of 13 pixels, left-aligned to `at`.
    pub(super) fn new(text: impl Into<String>, at: [f64; 2]) -> Self {
        Self { text: text.into(), at, size: 13.0, bold: false, colour: INK, side: Side::Left }
    }

    pub(super) fn size(self, size: f64) -> Self {
        Self { size, ..self }
    }

    pub(super) fn bold(self) -> Self {
        Self { bold: true, ..self }
    }

    pub(super) fn muted(self) -> Self {
        Self { colour: MUTED, ..self }
    }

    pub(super) fn side(self, side: Side) -> Self {
        Self { side, ..self }
    }

    /// Its bounding box.
    pub(super) fn extent(&self) -> Extent {
        let (width, height) = (font::width_of(&self.text, self.size, self.bold), self.size);
        let [x, y] = self.at;
        let left = match self.side {
            Side::Left => x,
            Side::Middle => x - width / 2.0,
            Side::Right => x - width,
        };
        Extent::new(left, y - height / 2.0, left + width, y + height / 2.0)
    }
}

impl Drawing {
    pub(super) const fn new(width: u32, height: u32) -> Self {
        Self { width, height, shapes: Vec::new() }
    }

    /// Width and height in CSS pixels.
    pub const fn size(&self) -> (u32, u32) {
        (self.width, self.height)
    }

    /// Every text in the drawing, in drawing order.
    pub fn texts(&self) -> impl Iterator<Item = &str> {
        self.shapes.iter().filter_map(|shape| match shape {
            Shape::Text(text) => Some(text.text.as_str()),
            _ => None,
        })
    }

    pub(super) fn line(&mut self, points: impl Into<Vec<[f64; 2]>>, stroke: Stroke) {
        self.shapes.push(Shape::Line { points: points.into(), stroke });
    }

    pub(super) fn disc(&mut self, centre: [f64; 2], radius: f64, fill: Fill) {
        self.shapes.push(Shape::Disc { centre, radius, fill });
    }

    pub(super) fn ring(&mut self, centre: [f64; 2], radius: f64, stroke: Stroke) {
        self.shapes.push(Shape::Ring { centre, radius, stroke });
    }

    pub(super) fn area(&mut self, corners: impl Into<Vec<[f64; 2]>>, fill: Fill) {
        self.shapes.push(Shape::Area { corners: corners.into(), fill });
    }

    pub(super) fn rectangle(&mut self, extent: Extent, fill: Fill) {
        let Extent { left, top, right, bottom } = extent;
        self.area([[left, top], [right, top], [right, bottom], [left, bottom]], fill);
    }

    pub(super) fn text(&mut self, text: TextLine) {
        self.shapes.push(Shape::Text(text));
    }

    pub(super) fn picture(&mut self, at: Extent, image: ImageU8) {
        self.shapes.push(Shape::Picture { at, image });
    }

    /// A title, and a subtitle in smaller letters below.
    pub(super) fn heading(&mut self, title: &str, subtitle: &str) {
        let room = f64::from(self.width) - 2.0 * MARGIN;
        self.text(TextLine::new(font::shortened(title, 17.0, true, room), [MARGIN, 26.0]).size(17.0).bold());
        if !subtitle.is_empty() {
            self.text(TextLine::new(font::shortened(subtitle, 12.5, false, room), [MARGIN, 48.0]).size(12.5).muted());
        }
    }
}

/// The left margin of titles.
pub(super) const MARGIN: f64 = 20.0;
