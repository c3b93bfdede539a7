use std::sync::Arc;

use atsplat_numeric::Extremes as _;
use atsplat_pixels::ImageU8;
use plotters::style::RGBColor;

use super::font;
use super::theme::{INK, MUTED, NAME, SMALL, TITLE};

/// A drawing made of shapes, to be encoded as SVG or PNG.
///
/// Units are CSS pixels, +x right, +y down, with the origin in the upper left corner. Each shape has a role, from which
/// [`Drawing::faults`] knows what may cover what.
#[derive(Clone, Debug)]
pub struct Drawing {
    pub(in crate::plot) width: u32,
    pub(in crate::plot) height: u32,
    pub(in crate::plot) items: Vec<Item>,
    role: Role,
    axes: u32,
}

/// A shape and what it means; later items are above earlier ones.
#[derive(Clone, Debug, PartialEq)]
pub(in crate::plot) struct Item {
    pub(in crate::plot) shape: Shape,
    pub(in crate::plot) role: Role,
}

/// An element of a drawing.
#[derive(Clone, Debug, PartialEq)]
pub(in crate::plot) enum Shape {
    Line { points: Vec<[f64; 2]>, stroke: Stroke },
    Disc { centre: [f64; 2], radius: f64, fill: Fill },
    Ring { centre: [f64; 2], radius: f64, stroke: Stroke },
    Area { corners: Vec<[f64; 2]>, fill: Fill },
    Text(TextLine),
    Image { at: Extent, image: ImageU8 },
}

/// What a shape means.
#[derive(Clone, Debug, PartialEq)]
pub(in crate::plot) enum Role {
    /// Grid lines, tinted bins, images, texts without another role.
    Plain,
    /// Lines that no text may cross: axes, ticks, diagonals.
    Frame,
    /// Marks, lines and bars of the series of this name.
    Data(Arc<str>),
    /// The area of the intervals of a series.
    Band(Arc<str>),
    /// A series' sample in the legend, or its name at the end of its curve.
    Key(Arc<str>),
    /// A text inside a bar.
    Inside,
    /// The plot's title.
    Title,
    /// The lines below the title: protocol, data, n.
    Subtitle,
    /// A tick's label on the axis of this number.
    Tick(u32),
    /// The title of the axis of this number.
    Axis(u32),
}

/// How a line is drawn.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(in crate::plot) struct Stroke {
    pub(in crate::plot) colour: RGBColor,
    pub(in crate::plot) width: f64,
}

/// How an area is filled; opacity in [0, 1].
#[derive(Clone, Copy, Debug, PartialEq)]
pub(in crate::plot) struct Fill {
    pub(in crate::plot) colour: RGBColor,
    pub(in crate::plot) opacity: f64,
}

/// A text, vertically centred on `at` and horizontally aligned to it by `side`; in several lines if it is wider than `room`.
#[derive(Clone, Debug, PartialEq)]
pub(in crate::plot) struct TextLine {
    pub(in crate::plot) text: String,
    pub(in crate::plot) at: [f64; 2],
    pub(in crate::plot) size: f64,
    pub(in crate::plot) bold: bool,
    pub(in crate::plot) colour: RGBColor,
    pub(in crate::plot) side: Side,
    pub(in crate::plot) room: f64,
}

/// The part of a text that is aligned to its position.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(in crate::plot) enum Side {
    Left,
    Middle,
    Right,
}

/// A rectangle: left, top, right, bottom.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(in crate::plot) struct Extent {
    pub(in crate::plot) left: f64,
    pub(in crate::plot) top: f64,
    pub(in crate::plot) right: f64,
    pub(in crate::plot) bottom: f64,
}

impl Extent {
    pub(in crate::plot) const fn new(left: f64, top: f64, right: f64, bottom: f64) -> Self {
        Self { left, top, right, bottom }
    }

    pub(in crate::plot) fn width(self) -> f64 {
        self.right - self.left
    }

    pub(in crate::plot) fn height(self) -> f64 {
        self.bottom - self.top
    }

    /// Moved inwards by `margin` on every side.
    pub(in crate::plot) fn inset(self, margin: f64) -> Self {
        Self::new(self.left + margin, self.top + margin, self.right - margin, self.bottom - margin)
    }

    /// The area of the intersection, in square pixels.
    pub(in crate::plot) fn shared(self, other: Self) -> f64 {
        let length = |low: f64, high: f64| (high - low).clamp(0.0, f64::INFINITY);
        let width = length(self.left.maximum_of(other.left), self.right.minimum_of(other.right));
        let height = length(self.top.maximum_of(other.top), self.bottom.minimum_of(other.bottom));
        width * height
    }

    pub(in crate::plot) fn contains(self, other: Self) -> bool {
        self.left <= other.left && self.top <= other.top && other.right <= self.right && other.bottom <= self.bottom
    }
}

impl Stroke {
    pub(in crate::plot) const fn new(colour: RGBColor, width: f64) -> Self {
        Self { colour, width }
    }
}

impl Fill {
    pub(in crate::plot) const fn solid(colour: RGBColor) -> Self {
        Self { colour, opacity: 1.0 }
    }

    pub(in crate::plot) const fn faint(colour: RGBColor, opacity: f64) -> Self {
        Self { colour, opacity }
    }
}

impl TextLine {
    /// The distance between the lines of a text, relative to its size.
    const PITCH: f64 = 1.25;

    /// Plain text in the size of names, left-aligned to `at`.
    pub(in crate::plot) fn new(text: impl Into<String>, at: [f64; 2]) -> Self {
        let text = text.into();
        Self { text, at, size: NAME, bold: false, colour: INK, side: Side::Left, room: f64::INFINITY }
    }

    pub(in crate::plot) fn small(self) -> Self {
        Self { size: SMALL, ..self }
    }

    pub(in crate::plot) fn bold(self) -> Self {
        Self { bold: true, ..self }
    }

    pub(in crate::plot) fn muted(self) -> Self {
        Self { colour: MUTED, ..self }
    }

    pub(in crate::plot) fn side(self, side: Side) -> Self {
        Self { side, ..self }
    }

    /// Broken into lines of at most this width.
    pub(in crate::plot) fn within(self, room: f64) -> Self {
        Self { room, ..self }
    }

    /// Moved so that its upper edge is at `y`.
    pub(in crate::plot) fn below(mut self, y: f64) -> Self {
        self.at[1] = y + self.height() / 2.0;
        self
    }

    /// Each line with its own position.
    pub(in crate::plot) fn lines(&self) -> Vec<Self> {
        let lines = font::wrapped(&self.text, self.size, self.bold, self.room);
        let pitch = self.size * Self::PITCH;
        let first = self.at[1] - pitch * (lines.len() as f64 - 1.0) / 2.0;
        let line = |(at, text): (usize, String)| Self {
            text,
            at: [self.at[0], first + pitch * at as f64],
            room: f64::INFINITY,
            ..self.clone()
        };
        lines.into_iter().enumerate().map(line).collect()
    }

    pub(in crate::plot) fn height(&self) -> f64 {
        let lines = font::wrapped(&self.text, self.size, self.bold, self.room).len() as f64;
        self.size * (1.0 + Self::PITCH * (lines - 1.0))
    }

    /// Its bounding box.
    pub(in crate::plot) fn extent(&self) -> Extent {
        let lines = font::wrapped(&self.text, self.size, self.bold, self.room);
        let widths = lines.iter().map(|line| font::width_of(line, self.size, self.bold));
        let width = widths.fold(0.0, f64::maximum_of);
        let height = self.size * (1.0 + Self::PITCH * (lines.len() as f64 - 1.0));
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
    pub(in crate::plot) const fn new(width: u32, height: u32) -> Self {
        Self { width, height, items: Vec::new(), role: Role::Plain, axes: 0 }
    }

    /// A drawing of this width with its heading, and the lower edge of the heading. [`end_at`](Self::end_at) sets the height.
    pub(in crate::plot) fn titled(width: u32, title: &str, subtitle: &str) -> (Self, f64) {
        let mut drawing = Self::new(width, 0);
        let room = f64::from(width) - 2.0 * MARGIN;
        let title = TextLine { size: TITLE, ..TextLine::new(title, [MARGIN, 0.0]) }.bold().within(room).below(16.0);
        let mut bottom = title.extent().bottom;
        drawing.with(Role::Title, |drawing| drawing.text(title));
        if !subtitle.is_empty() {
            let subtitle = TextLine::new(subtitle, [MARGIN, 0.0]).small().muted().within(room).below(bottom + 8.0);
            bottom = subtitle.extent().bottom;
            drawing.with(Role::Subtitle, |drawing| drawing.text(subtitle));
        }
        (drawing, bottom)
    }

    /// Sets the height, in whole pixels.
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "a page of plots is thousands of pixels high"
    )]
    pub(in crate::plot) fn end_at(&mut self, bottom: f64) {
        self.height = bottom.ceil() as u32;
    }

    /// Width and height in CSS pixels.
    pub const fn size(&self) -> (u32, u32) {
        (self.width, self.height)
    }

    /// Every text in the drawing, in drawing order.
    pub fn texts(&self) -> impl Iterator<Item = &str> {
        self.items.iter().filter_map(|item| match &item.shape {
            Shape::Text(text) => Some(text.text.as_str()),
            _ => None,
        })
    }

    /// Gives everything that `draw` adds a role.
    pub(in crate::plot) fn with<T>(&mut self, role: Role, draw: impl FnOnce(&mut Self) -> T) -> T {
        let before = std::mem::replace(&mut self.role, role);
        let result = draw(self);
        self.role = before;
        result
    }

    /// Marks what `draw` adds as data of a series.
    pub(in crate::plot) fn data<T>(&mut self, series: &str, draw: impl FnOnce(&mut Self) -> T) -> T {
        self.with(Role::Data(series.into()), draw)
    }

    /// Marks what `draw` adds as the legend of a series.
    pub(in crate::plot) fn key<T>(&mut self, series: &str, draw: impl FnOnce(&mut Self) -> T) -> T {
        self.with(Role::Key(series.into()), draw)
    }

    /// The number of a further axis.
    pub(in crate::plot) fn next_axis(&mut self) -> u32 {
        self.axes += 1;
        self.axes
    }

    pub(in crate::plot) fn push(&mut self, shape: Shape) {
        self.items.push(Item { shape, role: self.role.clone() });
    }

    pub(in crate::plot) fn line(&mut self, points: impl Into<Vec<[f64; 2]>>, stroke: Stroke) {
        self.push(Shape::Line { points: points.into(), stroke });
    }

    pub(in crate::plot) fn disc(&mut self, centre: [f64; 2], radius: f64, fill: Fill) {
        self.push(Shape::Disc { centre, radius, fill });
    }

    pub(in crate::plot) fn ring(&mut self, centre: [f64; 2], radius: f64, stroke: Stroke) {
        self.push(Shape::Ring { centre, radius, stroke });
    }

    pub(in crate::plot) fn area(&mut self, corners: impl Into<Vec<[f64; 2]>>, fill: Fill) {
        self.push(Shape::Area { corners: corners.into(), fill });
    }

    pub(in crate::plot) fn rectangle(&mut self, extent: Extent, fill: Fill) {
        let Extent { left, top, right, bottom } = extent;
        self.area([[left, top], [right, top], [right, bottom], [left, bottom]], fill);
    }

    pub(in crate::plot) fn text(&mut self, text: TextLine) {
        self.push(Shape::Text(text));
    }

    pub(in crate::plot) fn image(&mut self, at: Extent, image: ImageU8) {
        self.push(Shape::Image { at, image });
    }

    /// A legend's sample of a filled area around `place`.
    pub(in crate::plot) fn swatch(&mut self, [x, y]: [f64; 2], fill: Fill) {
        self.rectangle(Extent::new(x - 7.0, y - 6.0, x + 7.0, y + 6.0), fill);
    }

    /// A legend in rows from `top` on: a sample, drawn by `sample` around its middle, and a name for each series. Returns its
    /// lower edge.
    pub(in crate::plot) fn legend(
        &mut self,
        left: f64,
        top: f64,
        names: &[&str],
        sample: impl Fn(&mut Self, usize, [f64; 2]),
    ) -> f64 {
        const SAMPLE: f64 = 20.0;
        let most = f64::from(self.width) - MARGIN;
        let (mut x, mut y, mut bottom) = (left, top, top);
        for (at, name) in names.iter().enumerate() {
            let place =
                |x: f64, y: f64| TextLine::new(*name, [x + SAMPLE, y]).small().within(most - left - SAMPLE).below(y);
            let mut text = place(x, y);
            if text.extent().right > most && x > left {
                (x, y) = (left, bottom + 6.0);
                text = place(x, y);
            }
            let extent = text.extent();
            (bottom, x) = (bottom.maximum_of(extent.bottom), extent.right + 20.0);
            let middle = [extent.left - SAMPLE + 7.0, y + SMALL / 2.0];
            self.key(name, |drawing| {
                sample(drawing, at, middle);
                drawing.text(text);
            });
        }
        bottom
    }
}

/// The left margin of titles.
pub(in crate::plot) const MARGIN: f64 = 20.0;
