use atsplat_numeric::Extremes as _;

use super::axes::{Axes, AxisText};
use super::font::{shortened, width_of};
use super::scale::{Scale, seconds_label};
use super::shape::{Drawing, Extent, Fill, Side, Stroke, TextLine};
use super::theme::{GRID, MUTED, ON_LIGHT, SURFACE, colour};

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
        const ROW: f64 = 62.0;
        let mut names: Vec<&str> = Vec::new();
        for (name, _) in self.rows.iter().flat_map(|row| &row.stages) {
            if !names.contains(&name.as_str()) {
                names.push(name);
            }
        }
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a few rows")]
        let mut drawing = Drawing::new(900, (160.0 + ROW * self.rows.len() as f64) as u32);
        drawing.heading(&self.title, &self.subtitle);
        let total = |row: &StageTimeRow| row.stages.iter().map(|(_, secs)| secs).sum::<f64>();
        let totals = self.rows.iter().flat_map(|row| [Some(total(row)), row.spread.map(|ends| ends[1])]).flatten();
        let longest = self.rows.iter().map(|row| width_of(&row.label, 13.0, false)).fold(0.0, f64::maximum_of);
        let room = longest.clamp(80.0, 300.0);
        let inside = Extent::new(room + 34.0, 104.0, 800.0, 104.0 + ROW * self.rows.len() as f64);
        let axes = Axes { inside, x: Scale::from_zero(totals), y: Scale::linear(0.0, 1.0) };
        for tick in axes.x.ticks(7) {
            drawing.line([[axes.x_of(tick), inside.top], [axes.x_of(tick), inside.bottom]], Stroke::new(GRID, 1.0));
        }
        let label = |secs: f64, _: &[f64]| if secs > 0.0 { seconds_label(secs) } else { "0".to_owned() };
        axes.draw_x(&mut drawing, &AxisText { title: "seconds, one after the other", label: &label });
        Self::key(&mut drawing, &names);
        for (at, row) in self.rows.iter().enumerate() {
            let middle = inside.top + ROW * (at as f64 + 0.5);
            drawing.text(
                TextLine::new(shortened(&row.label, 13.0, false, room), [inside.left - 12.0, middle]).side(Side::Right),
            );
            if let Some(reason) = &row.untimed {
                let at = [inside.left + 8.0, middle];
                let room = f64::from(drawing.size().0) - at[0] - 16.0;
                let reason = shortened(&format!("not timed: {reason}"), 12.0, false, room);
                drawing.text(TextLine::new(reason, at).size(12.0).muted());
                continue;
            }
            let mut from = 0.0;
            for (name, secs) in row.stages.iter().filter(|(_, secs)| *secs > 0.0) {
                #[expect(clippy::expect_used, reason = "the names were collected from the same rows")]
                let stage = names.iter().position(|known| known == name).expect("the name of a stage");
                let part = Extent::new(axes.x_of(from), middle - 16.0, axes.x_of(from + secs), middle + 16.0);
                drawing.rectangle(part, Fill::solid(colour(stage)));
                drawing.line([[part.right, part.top], [part.right, part.bottom]], Stroke::new(SURFACE, 1.0));
                let text = seconds_label(*secs);
                if width_of(&text, 11.5, true) + 10.0 < part.width() {
                    let light = stage % 6 >= 3;
                    let text = TextLine::new(text, [f64::midpoint(part.left, part.right), middle])
                        .size(11.5)
                        .bold()
                        .side(Side::Middle);
                    drawing.text(TextLine { colour: if light { ON_LIGHT } else { SURFACE }, ..text });
                }
                from += secs;
            }
            let mut right = axes.x_of(from);
            if let Some([low, high]) = row.spread {
                let [low, high] = [axes.x_of(low), axes.x_of(high)];
                let stroke = || Stroke::new(MUTED, 1.5);
                drawing.line([[low, middle], [high, middle]], stroke());
                for x in [low, high] {
                    drawing.line([[x, middle - 5.0], [x, middle + 5.0]], stroke());
                }
                right = right.maximum_of(high);
            }
            drawing.text(TextLine::new(seconds_label(from), [right + 8.0, middle]).size(12.5).bold());
        }
        drawing
    }

    fn key(drawing: &mut Drawing, names: &[&str]) {
        let mut x = 20.0;
        for (at, name) in names.iter().enumerate() {
            let text = TextLine::new(shortened(name, 12.0, false, 160.0), [x + 20.0, 76.0]).size(12.0);
            let right = text.extent().right;
            if right > f64::from(drawing.size().0) - 20.0 {
                break;
            }
            drawing.rectangle(Extent::new(x, 70.0, x + 14.0, 82.0), Fill::solid(colour(at)));
            drawing.text(text);
            x = right + 20.0;
        }
    }
}
