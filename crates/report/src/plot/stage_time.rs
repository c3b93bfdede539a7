use atsplat_numeric::{Extremes as _, distinct};

use super::drawing::axes::Axes;
use super::drawing::scale::{Scale, seconds_label, time_unit};
use super::drawing::series::{level_whisker, number_axis};
use super::drawing::shape::{Drawing, Extent, Fill, MARGIN, Role, Side, Stroke, TextLine};
use super::drawing::theme::{INK, SURFACE, colour, text_on};

/// Where the time goes: a bar per method, divided into stages.
#[derive(Clone, Debug)]
pub struct StageTime {
    /// Title.
    pub title: String,
    /// Machine, threads.
    pub subtitle: String,
    /// The methods.
    pub rows: Vec<StageTimeRow>,
}

/// One method.
#[derive(Clone, Debug)]
pub struct StageTimeRow {
    /// Its name.
    pub label: String,
    /// Stage and seconds, in the order in which they run.
    pub stages: Vec<(String, f64)>,
    /// Seconds until the first image: their median, to which the stages' medians need not add up.
    pub total: Option<f64>,
    /// Quartiles of the total.
    pub spread: Option<[f64; 2]>,
    /// Why there are no times; shown in place of the bar.
    pub untimed: Option<String>,
}

const WIDTH: u32 = 900;

impl StageTime {
    /// Draws it.
    pub fn draw(&self) -> Drawing {
        const ROW: f64 = 54.0;
        let (mut drawing, head) = Drawing::titled(WIDTH, &self.title, &self.subtitle);
        let names = distinct(self.rows.iter().flat_map(|row| &row.stages).map(|(name, _)| name.as_str()));
        let bottom = drawing.legend(MARGIN, head + 12.0, &names, |drawing, at, place| {
            drawing.swatch(place, Fill::solid(colour(at)));
        });
        let label = |row: &StageTimeRow| TextLine::new(&*row.label, [0.0; 2]).side(Side::Right).within(300.0);
        let left = 34.0 + self.rows.iter().map(|row| label(row).extent().width()).fold(80.0, f64::maximum_of);
        let height = |row: &StageTimeRow| {
            let reason = reason(row, left).map_or(0.0, |reason| reason.height());
            (label(row).height().maximum_of(reason) + 14.0).maximum_of(ROW)
        };
        let heights: Vec<f64> = self.rows.iter().map(height).collect();
        let top = bottom + 12.0;
        let inside = Extent::new(left, top, 800.0, top + heights.iter().sum::<f64>());
        let (unit, length) = time_unit(self.rows.iter().flat_map(ends));
        let x = Scale::from_zero(self.rows.iter().flat_map(ends).map(|secs| secs / length));
        let axes = Axes { inside, x, y: Scale::linear(0.0, 1.0) };
        axes.draw_x_grid(&mut drawing, &axes.x_ticks());
        let title = format!("{unit} until the first image, stages one after the other");
        let bottom = axes.draw_x(&mut drawing, &number_axis(&title));
        let mut upper = top;
        for (row, height) in self.rows.iter().zip(heights) {
            let middle = upper + height / 2.0;
            upper += height;
            drawing.text(TextLine { at: [inside.left - 12.0, middle], ..label(row) });
            match reason(row, left) {
                None => bar(&mut drawing, axes, row, &names, middle, length),
                Some(reason) => drawing.text(TextLine { at: [reason.at[0], middle], ..reason }),
            }
        }
        drawing.end_at(bottom + 14.0);
        drawing
    }
}

/// Where a row's bar, total and quartiles end, in seconds.
fn ends(row: &StageTimeRow) -> impl Iterator<Item = f64> {
    let bar = row.stages.iter().map(|(_, secs)| secs).sum::<f64>();
    [Some(bar), row.total, row.spread.map(|quartiles| quartiles[1])].into_iter().flatten()
}

/// Why a row has no bar, from the left end of the axis on; the message of a process may have many lines.
fn reason(row: &StageTimeRow, left: f64) -> Option<TextLine> {
    let words: Vec<&str> = row.untimed.as_ref()?.split_whitespace().collect();
    let text = TextLine::new(format!("not timed: {}", words.join(" ")), [left + 8.0, 0.0]).small().muted();
    Some(text.within(f64::from(WIDTH) - left - 8.0 - MARGIN))
}

/// The parts of a bar with their times where there is room, the quartiles, and the total.
fn bar(drawing: &mut Drawing, axes: Axes, row: &StageTimeRow, names: &[&str], middle: f64, length: f64) {
    let x_of = |secs: f64| axes.x_of(secs / length);
    let mut from = 0.0;
    for (name, secs) in row.stages.iter().filter(|(_, secs)| *secs > 0.0) {
        #[expect(clippy::expect_used, reason = "the names were collected from the same rows")]
        let stage_colour = colour(names.iter().position(|known| known == name).expect("the name of a stage"));
        let part = Extent::new(x_of(from), middle - 16.0, x_of(from + secs), middle + 16.0);
        drawing.data(name, |drawing| drawing.rectangle(part, Fill::solid(stage_colour)));
        drawing.line([[part.right, part.top], [part.right, part.bottom]], Stroke::new(SURFACE, 1.0));
        let time = TextLine::new(seconds_label(*secs), [f64::midpoint(part.left, part.right), middle + 7.0]);
        let time = TextLine { colour: text_on(stage_colour), ..time.small().side(Side::Middle) };
        if time.extent().width() + 10.0 < part.width() {
            drawing.with(Role::Inside, |drawing| drawing.text(time));
        }
        from += secs;
    }
    let mut right = x_of(from);
    if let Some([low, high]) = row.spread {
        let ends = [x_of(low), x_of(high)];
        let stroke = Stroke::new(INK, 1.5);
        drawing.with(Role::Frame, |drawing| level_whisker(drawing, middle - 8.0, ends, stroke));
        right = right.maximum_of(ends[1]);
    }
    if let Some(total) = row.total {
        drawing.text(TextLine::new(seconds_label(total), [right + 8.0, middle]).bold());
    }
}
