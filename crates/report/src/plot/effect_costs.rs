use atsplat_numeric::Extremes as _;

use super::drawing::axes::Axes;
use super::drawing::scale::Scale;
use super::drawing::series::{level_whisker, note, number_axis};
use super::drawing::shape::{Drawing, Extent, Fill, Side, Stroke, TextLine};
use super::drawing::theme::{COLOURS, INK};

/// What each effect of simulated frames costs where it runs.
#[derive(Clone, Debug)]
pub struct EffectCosts {
    /// Title.
    pub title: String,
    /// Scenes, size, what all effects cost against those that are needed.
    pub subtitle: String,
    /// The effects, in the order of the plot.
    pub rows: Vec<EffectCostRow>,
    /// Below the plot.
    pub note: String,
}

/// An effect.
#[derive(Clone, Debug)]
pub struct EffectCostRow {
    /// Its name.
    pub effect: String,
    /// Number of scenes that need it.
    pub needed_by: usize,
    /// All scenes.
    pub scenes: usize,
    /// Milliseconds a frame, over the scenes where the effect can be measured: first quartile, median, third quartile; `None`
    /// if there is no such scene.
    pub millis: Option<[f64; 3]>,
}

impl EffectCosts {
    /// Draws it: for each effect a bar to the median, a line between the quartiles, and on the right the scenes that need it.
    pub fn draw(&self) -> Drawing {
        const ROW: f64 = 36.0;
        let (mut drawing, head) = Drawing::titled(860, &self.title, &self.subtitle);
        let top = head + 40.0;
        let label = |row: &EffectCostRow| TextLine::new(&*row.effect, [0.0; 2]).side(Side::Right).within(180.0);
        let heights: Vec<f64> = self.rows.iter().map(|row| (label(row).height() + 14.0).maximum_of(ROW)).collect();
        let axes = Axes {
            inside: Extent::new(214.0, top, 660.0, top + heights.iter().sum::<f64>()),
            x: Scale::from_zero(self.rows.iter().filter_map(|row| row.millis).flatten()),
            y: Scale::linear(0.0, 1.0),
        };
        let Extent { left, right, .. } = axes.inside;
        axes.draw_x_grid(&mut drawing, &axes.x_ticks());
        let below = axes.draw_x(&mut drawing, &number_axis("milliseconds a frame, where the effect runs"));
        drawing.text(TextLine::new("needed by", [right + 20.0, top - 12.0]).small().muted());
        let mut upper = top;
        for (row, height) in self.rows.iter().zip(heights) {
            let middle = upper + height / 2.0;
            upper += height;
            drawing.text(TextLine { at: [left - 14.0, middle], ..label(row) });
            let scenes = format!("{} of {} scenes", row.needed_by, row.scenes);
            drawing.text(TextLine::new(scenes, [right + 20.0, middle]).small());
            let Some([low, median, high]) = row.millis else {
                let why = if row.needed_by == 0 { "never runs" } else { "not measurable" };
                drawing.text(TextLine::new(why, [left + 8.0, middle]).small().muted());
                continue;
            };
            let [low, median, high] = [low, median, high].map(|millis| axes.x_of(millis));
            drawing.rectangle(Extent::new(left, middle - 9.0, median, middle + 9.0), Fill::solid(COLOURS[0]));
            level_whisker(&mut drawing, middle, [low, high], Stroke::new(INK, 1.5));
        }
        let bottom = note(&mut drawing, below, &self.note);
        drawing.end_at(bottom + 14.0);
        drawing
    }
}
