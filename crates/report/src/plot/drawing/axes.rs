use super::scale::Scale;
use super::shape::{Drawing, Extent, Role, Side, Stroke, TextLine};
use super::theme::{GRID, MUTED};

/// The area of a plot's data, and the scales of its axes.
#[derive(Clone, Copy, Debug)]
pub(in crate::plot) struct Axes {
    pub(in crate::plot) inside: Extent,
    pub(in crate::plot) x: Scale,
    pub(in crate::plot) y: Scale,
}

/// The title of an axis, with its unit, and the format of its tick labels, which are plain numbers in that unit.
pub(in crate::plot) struct AxisText<'a> {
    pub(in crate::plot) title: &'a str,
    pub(in crate::plot) label: &'a dyn Fn(f64, &[f64]) -> String,
}

impl Axes {
    pub(in crate::plot) fn x_of(&self, value: f64) -> f64 {
        self.inside.left + self.x.position(value) * self.inside.width()
    }

    pub(in crate::plot) fn y_of(&self, value: f64) -> f64 {
        self.inside.bottom - self.y.position(value) * self.inside.height()
    }

    pub(in crate::plot) fn place(&self, x: f64, y: f64) -> [f64; 2] {
        [self.x_of(x), self.y_of(y)]
    }

    /// Draws horizontal grid lines with labels on the left and the title above.
    pub(in crate::plot) fn draw_y(&self, drawing: &mut Drawing, text: &AxisText<'_>) {
        self.draw_y_below(drawing, text, 8.0);
    }

    /// Like [`Self::draw_y`], with the title `gap` above the plot.
    pub(in crate::plot) fn draw_y_below(&self, drawing: &mut Drawing, text: &AxisText<'_>, gap: f64) {
        let Extent { left, right, top, .. } = self.inside;
        let ticks = self.y_ticks();
        let axis = drawing.next_axis();
        for tick in &ticks {
            let y = self.y_of(*tick);
            drawing.line([[left, y], [right, y]], Stroke::new(GRID, 1.0));
            let label = TextLine::new((text.label)(*tick, &ticks), [left - 8.0, y]).small().muted().side(Side::Right);
            drawing.with(Role::Tick(axis), |drawing| drawing.text(label));
        }
        let mut title = TextLine::new(text.title, [left, 0.0]).small().muted().within(right - left + 40.0);
        title.at[1] = top - gap - title.height() / 2.0;
        drawing.with(Role::Axis(axis), |drawing| drawing.text(title));
    }

    /// Draws vertical grid lines.
    pub(in crate::plot) fn draw_x_grid(&self, drawing: &mut Drawing, ticks: &[f64]) {
        for tick in ticks {
            let x = self.x_of(*tick);
            drawing.line([[x, self.inside.top], [x, self.inside.bottom]], Stroke::new(GRID, 1.0));
        }
    }

    /// The round values at which the y axis has room for ticks.
    pub(in crate::plot) fn y_ticks(&self) -> Vec<f64> {
        self.y.ticks(fitting(self.inside.height(), 55.0, 8))
    }

    /// The round values at which the x axis has room for ticks.
    pub(in crate::plot) fn x_ticks(&self) -> Vec<f64> {
        self.x.ticks(fitting(self.inside.width(), 90.0, 12))
    }

    /// Draws the x axis with ticks, and the title below; returns its lower edge.
    pub(in crate::plot) fn draw_x(&self, drawing: &mut Drawing, text: &AxisText<'_>) -> f64 {
        self.draw_x_at(drawing, text, &self.x_ticks())
    }

    /// Like [`Self::draw_x`], with ticks at the given values; a label that has no room next to the previous one is omitted.
    pub(in crate::plot) fn draw_x_at(&self, drawing: &mut Drawing, text: &AxisText<'_>, ticks: &[f64]) -> f64 {
        let Extent { left, right, bottom, .. } = self.inside;
        let axis = drawing.next_axis();
        let stroke = Stroke::new(MUTED, 1.0);
        drawing.with(Role::Frame, |drawing| drawing.line([[left, bottom], [right, bottom]], stroke));
        let mut end = f64::NEG_INFINITY;
        for tick in ticks {
            let x = self.x_of(*tick);
            drawing.with(Role::Frame, |drawing| drawing.line([[x, bottom], [x, bottom + 5.0]], stroke));
            let label =
                TextLine::new((text.label)(*tick, ticks), [x, bottom + 16.0]).small().muted().side(Side::Middle);
            if label.extent().left > end + 4.0 {
                end = label.extent().right;
                drawing.with(Role::Tick(axis), |drawing| drawing.text(label));
            }
        }
        let middle = [f64::midpoint(left, right), 0.0];
        let title = TextLine::new(text.title, middle).small().muted().side(Side::Middle);
        let title = title.within(right - left + 40.0).below(bottom + 28.0);
        let below = title.extent().bottom;
        drawing.with(Role::Axis(axis), |drawing| drawing.text(title));
        below
    }
}

/// The number of ticks that fit a length, at least two.
fn fitting(length: f64, each: f64, most: usize) -> usize {
    (2..=most).rev().find(|count| *count as f64 * each <= length).unwrap_or(2)
}
