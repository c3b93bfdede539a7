use super::axes::Axes;
use super::font::shortened;
use super::scale::Scale;
use super::series::{Estimate, Figure, Origin, origin_key, plain, whisker};
use super::shape::{Drawing, Extent, Fill, Side, Stroke, TextLine};
use super::theme::{GRID, MUTED, colour};

/// Quality in each overlap bin, and the average over all scenes.
#[derive(Clone, Debug)]
pub struct OverlapBinMeans {
    /// Title.
    pub title: String,
    /// Protocol, scenes.
    pub subtitle: String,
    /// The metric.
    pub quality: Figure,
    /// Names of the bins, the average last.
    pub bins: Vec<String>,
    /// A mark per bin and method.
    pub series: Vec<OverlapBinSeries>,
}

/// One method.
#[derive(Clone, Debug)]
pub struct OverlapBinSeries {
    /// Its name.
    pub label: String,
    /// Means in the order of the bins; `None` for bins without scenes.
    pub means: Vec<Option<Estimate>>,
    /// Published marks are hollow.
    pub origin: Origin,
}

impl OverlapBinMeans {
    /// Draws it: a column per bin, with a mark per method in the order of the legend.
    pub fn draw(&self) -> Drawing {
        const ROW: f64 = 20.0;
        let per_row = 3;
        let rows = self.series.len().div_ceil(per_row) as f64;
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a few rows of names")]
        let mut drawing = Drawing::new(860, 470 + (rows * ROW) as u32);
        drawing.heading(&self.title, &self.subtitle);
        let values = self.series.iter().flat_map(|series| series.means.iter().flatten().flat_map(|mean| mean.extent()));
        let axes = Axes {
            inside: Extent::new(64.0, 100.0, 836.0, 420.0),
            x: Scale::linear(0.0, self.bins.len() as f64),
            y: Scale::around(values, 0.08),
        };
        let Extent { top, bottom, .. } = axes.inside;
        for (bin, name) in self.bins.iter().enumerate() {
            let (left, right) = (axes.x_of(bin as f64), axes.x_of(bin as f64 + 1.0));
            if bin % 2 == 1 {
                drawing.rectangle(Extent::new(left, top, right, bottom), Fill::faint(GRID, 0.4));
            }
            let name = shortened(name, 13.0, false, right - left - 8.0);
            drawing.text(TextLine::new(name, [f64::midpoint(left, right), bottom + 18.0]).side(Side::Middle));
        }
        axes.draw_y(&mut drawing, &plain(&self.quality.title()));
        drawing.line([[axes.inside.left, bottom], [axes.inside.right, bottom]], Stroke::new(MUTED, 1.0));
        if self.series.iter().any(|series| series.origin == Origin::Published) {
            origin_key(&mut drawing);
        }
        for (at, series) in self.series.iter().enumerate() {
            let own = colour(at);
            let mark = |drawing: &mut Drawing, place: [f64; 2]| match series.origin {
                Origin::Published => drawing.ring(place, 4.5, Stroke::new(own, 2.0)),
                Origin::Measured => drawing.disc(place, 5.0, Fill::solid(own)),
            };
            for (bin, mean) in series.means.iter().enumerate() {
                let Some(mean) = mean else { continue };
                let place = axes.place(bin as f64 + (at as f64 + 1.0) / (self.series.len() as f64 + 1.0), mean.value);
                if let Some(interval) = mean.interval {
                    whisker(&mut drawing, place[0], interval.map(|value| axes.y_of(value)), Stroke::new(own, 1.5));
                }
                mark(&mut drawing, place);
            }
            let (row, column) = (at / per_row, at % per_row);
            let place = [72.0 + 260.0 * column as f64, bottom + 44.0 + ROW * row as f64];
            mark(&mut drawing, place);
            drawing.text(
                TextLine::new(shortened(&series.label, 12.5, false, 230.0), [place[0] + 12.0, place[1]]).size(12.5),
            );
        }
        drawing
    }
}
