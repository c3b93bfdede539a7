use atsplat_numeric::Extremes as _;

use super::axes::Axes;
use super::scale::{Scale, seconds_label, time_unit};
use super::series::number_axis;
use super::shape::{Drawing, Extent, Fill, MARGIN, Role, Side, Stroke, TextLine};
use super::theme::{INK, SURFACE, colour, text_on};

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
    /// Quartiles of the total.
    pub spread: Option<[f64; 2]>,
    /// Why there are no times; shown in place of the bar.
    pub untimed: Option<String>,
}

impl StageTime {
    /// Draws it.
    pub fn draw(&self) -> Drawing {
        const ROW: f64 = 54.0;
        let (mut drawing, head) = Drawing::titled(900, &self.title, &self.subtitle);
        let mut names: Vec<&str> = Vec::new();
        for (name, _) in self.rows.iter().flat_map(|row| &row.stages) {
            if !names.contains(&name.as_str()) {
                names.push(name);
            }
        }
        let bottom = drawing.legend(MARGIN, head + 12.0, &names, |drawing, at, [x, y]| {
            drawing.rectangle(Extent::new(x - 7.0, y - 6.0, x + 7.0, y + 6.0), Fill::solid(colour(at)));
        });
        let total = |row: &StageTimeRow| row.stages.iter().map(|(_, secs)| secs).sum::<f64>();
        let totals = || self.rows.iter().flat_map(|row| [Some(total(row)), row.spread.map(|ends| ends[1])]).flatten();
        let label = |row: &StageTimeRow| TextLine::new(&*row.label, [0.0; 2]).side(Side::Right).within(300.0);
        let room = self.rows.iter().map(|row| label(row).extent().width()).fold(80.0, f64::maximum_of);
        let heights: Vec<f64> = self.rows.iter().map(|row| (label(row).height() + 14.0).maximum_of(ROW)).collect();
        let top = bottom + 12.0;
        let inside = Extent::new(room + 34.0, top, 800.0, top + heights.iter().sum::<f64>());
        let (unit, length) = time_unit(totals());
        let axes = Axes { inside, x: Scale::from_zero(totals().map(|secs| secs / length)), y: Scale::linear(0.0, 1.0) };
        axes.draw_x_grid(&mut drawing, &axes.x_ticks());
        let title = format!("{unit} until the first image, stages one after the other");
        let bottom = axes.draw_x(&mut drawing, &number_axis(&title));
        let mut upper = top;
        for (row, height) in self.rows.iter().zip(heights) {
            let middle = upper + height / 2.0;
            upper += height;
            drawing.text(TextLine { at: [inside.left - 12.0, middle], ..label(row) });
            match &row.untimed {
                None => bar(&mut drawing, axes, row, &names, middle, length),
                Some(reason) => {
                    let at = [inside.left + 8.0, middle];
                    let reason = TextLine::new(format!("not timed: {reason}"), at).small().muted();
                    drawing.text(reason.within(f64::from(drawing.size().0) - at[0] - MARGIN));
                }
            }
        }
        drawing.end_at(bottom + 14.0);
        drawing
    }
}

/// The parts of a bar with their times where there is room, the quartiles, and the total.
fn bar(drawing: &mut Drawing, axes: Axes, row: &StageTimeRow, names: &[&str], middle: f64, length: f64) {
    let x_of = |secs: f64| axes.x_of(secs / length);
    let mut from = 0.0;
    for (name, secs) in row.stages.iter().filter(|(_, secs)| *secs > 0.0) {
        #[expect(clippy::expect_used, reason = "the names were collected from the same rows")]
        let own = colour(names.iter().position(|known| known == name).expect("the name of a stage"));
        let part = Extent::new(x_of(from), middle - 16.0, x_of(from + secs), middle + 16.0);
        drawing.data(name, |drawing| drawing.rectangle(part, Fill::solid(own)));
        drawing.line([[part.right, part.top], [part.right, part.bottom]], Stroke::new(SURFACE, 1.0));
        let time = TextLine::new(seconds_label(*secs), [f64::midpoint(part.left, part.right), middle + 7.0]);
        let time = TextLine { colour: text_on(own), ..time.small().side(Side::Middle) };
        if time.extent().width() + 10.0 < part.width() {
            drawing.with(Role::Inside, |drawing| drawing.text(time));
        }
        from += secs;
    }
    let mut right = x_of(from);
    if let Some([low, high]) = row.spread {
        let (y, stroke) = (middle - 8.0, Stroke::new(INK, 1.5));
        let [low, high] = [x_of(low), x_of(high)];
        drawing.with(Role::Frame, |drawing| {
            drawing.line([[low, y], [high, y]], stroke);
            for x in [low, high] {
                drawing.line([[x, y - 4.0], [x, y + 4.0]], stroke);
            }
        });
        right = right.maximum_of(high);
    }
    drawing.text(TextLine::new(seconds_label(from), [right + 8.0, middle]).bold());
}
