use super::scale::Scale;
use super::shape::{Drawing, Extent, Side, Stroke, TextLine};
use super::theme::{GRID, MUTED};

/// The area of a plot's data, and the scales of its axes.
#[derive(Clone, Copy, Debug)]
pub(super) struct Axes {
    pub(super) inside: Extent,
    pub(super) x: Scale,
    pub(super) y: Scale,
}

/// The title of an axis, and the format of its tick labels.
pub(super) struct AxisText<'a> {
    pub(super) title: &'a str,
    pub(super) label: &'a dyn Fn(f64, &[f64]) -> String,
}

impl Axes {
    pub(super) fn x_of(&self, value: f64) -> f64 {
        self.inside.left + self.x.share(value) * self.inside.width()
    }

    pub(super) fn y_of(&self, value: f64) -> f64 {
        self.inside.bottom - self.y.share(value) * self.inside.height()
    }

    pub(super) fn place(&self, x: f64, y: f64) -> [f64; 2] {
        [self.x_of(x), self.y_of(y)]
    }

    /// Draws horizontal grid lines with labels on the left and the title above.
    pub(super) fn draw_y(&self, drawing: &mut Drawing, text: &AxisText<'_>) {
        let Extent { left, right, top, .. } = self.inside;
        let ticks = self.y.ticks(fitting(self.inside.height(), 55.0, 8));
        for tick in &ticks {
            let y = self.y_of(*tick);
            drawing.line([[left, y], [right, y]], Stroke::new(GRID, 1.0));
            drawing
                .text(TextLine::new((text.label)(*tick, &ticks), [left - 8.0, y]).size(12.0).muted().side(Side::Right));
        }
        drawing.text(TextLine::new(text.title, [left, top - 14.0]).size(12.0).muted());
    }

    /// Draws the x axis with ticks, and the title below.
    pub(super) fn draw_x(&self, drawing: &mut Drawing, text: &AxisText<'_>) {
        let ticks = self.x.ticks(fitting(self.inside.width(), 90.0, 12));
        self.draw_x_at(drawing, text, &ticks);
    }

    /// As [`Self::draw_x`], with ticks at the given values.
    pub(super) fn draw_x_at(&self, drawing: &mut Drawing, text: &AxisText<'_>, ticks: &[f64]) {
        let Extent { left, right, bottom, .. } = self.inside;
        drawing.line([[left, bottom], [right, bottom]], Stroke::new(MUTED, 1.0));
        for tick in ticks {
            let x = self.x_of(*tick);
            drawing.line([[x, bottom], [x, bottom + 5.0]], Stroke::new(MUTED, 1.0));
            drawing.text(
                TextLine::new((text.label)(*tick, ticks), [x, bottom + 16.0]).size(12.0).muted().side(Side::Middle),
            );
        }
        drawing.text(
            TextLine::new(text.title, [f64::midpoint(left, right), bottom + 36.0])
                .size(12.5)
                .muted()
                .side(Side::Middle),
        );
    }
}

/// The number of ticks that fit a length, at least two.
fn fitting(length: f64, each: f64, most: usize) -> usize {
    (2..=most).rev().find(|count| *count as f64 * each <= length).unwrap_or(2)
}
