use super::axes::Axes;
use super::font::shortened;
use super::labels::Labels;
use super::scale::Scale;
use super::series::{Estimate, Figure, plain, whisker};
use super::shape::{Drawing, Extent, Fill, Side, Stroke, TextLine};
use super::theme::{COLOURS, GREY, INK};

/// The smallest visible height of a band, in pixels.
const THINNEST: f64 = 4.0;

/// A metric over runs, with the limits of the baseline accepted at the time.
#[derive(Clone, Debug)]
pub struct DriftHistory {
    /// Title.
    pub title: String,
    /// Protocol, method.
    pub subtitle: String,
    /// The metric.
    pub quality: Figure,
    /// Runs, oldest first.
    pub runs: Vec<DriftRun>,
}

/// One run.
#[derive(Clone, Debug)]
pub struct DriftRun {
    /// Commit, date, or another text that distinguishes runs.
    pub label: String,
    /// The mean.
    pub quality: Estimate,
    /// The baseline's limits: low, high.
    pub limits: Option<[f64; 2]>,
    /// If drift was found: what moved the number, or an empty text if an earlier run states it.
    pub drift: Option<String>,
}

impl DriftHistory {
    /// Draws it.
    pub fn draw(&self) -> Drawing {
        let mut drawing = Drawing::new(860, 460);
        drawing.heading(&self.title, &self.subtitle);
        let values = self.runs.iter().flat_map(|run| run.quality.extent().chain(run.limits.into_iter().flatten()));
        let axes = Axes {
            inside: Extent::new(72.0, 104.0, 836.0, 380.0),
            x: Scale::linear(-0.5, self.runs.len() as f64 - 0.5),
            y: Scale::around(values, 0.12),
        };
        axes.draw_y(&mut drawing, &plain(&self.quality.title()));
        let Extent { bottom, .. } = axes.inside;
        let mut from = 0.0;
        for runs in self.runs.chunk_by(|a, b| a.limits == b.limits) {
            let to = from + runs.len() as f64;
            if let Some(limits) = runs.first().and_then(|run| run.limits) {
                let [low, high] = limits.map(|limit| axes.y_of(limit));
                // If results must be identical, both limits are equal.
                let thin = if low - high < THINNEST { (THINNEST - (low - high)) / 2.0 } else { 0.0 };
                let band = Extent::new(axes.x_of(from - 0.5), high - thin, axes.x_of(to - 0.5), low + thin);
                drawing.rectangle(band, Fill::faint(COLOURS[2], 0.18));
            }
            from = to;
        }
        let line: Vec<_> =
            self.runs.iter().enumerate().map(|(at, run)| axes.place(at as f64, run.quality.value)).collect();
        if line.len() > 1 {
            drawing.line(line.clone(), Stroke::new(GREY, 1.5));
        }
        let mut labels = Labels::new(Extent::new(axes.inside.left, 84.0, 856.0, bottom - 4.0));
        labels.avoid_line(&line);
        let room = axes.inside.width() / self.runs.len().clamp(1, usize::MAX) as f64;
        let every = (58.0 / room).ceil().clamp(1.0, 1e6);
        for (at, (run, place)) in self.runs.iter().zip(&line).enumerate() {
            if let Some(interval) = run.quality.interval {
                whisker(&mut drawing, place[0], interval.map(|value| axes.y_of(value)), Stroke::new(COLOURS[0], 1.5));
            }
            labels.avoid(*place, 8.0);
            if run.drift.is_some() {
                drawing.disc(*place, 7.0, Fill::solid(COLOURS[1]));
            } else {
                drawing.disc(*place, 4.5, Fill::solid(COLOURS[0]));
            }
            if (at as f64 / every).fract() == 0.0 {
                let text = shortened(&run.label, 11.0, false, room * every - 6.0);
                drawing.text(TextLine::new(text, [place[0], bottom + 16.0]).size(11.0).muted().side(Side::Middle));
            }
        }
        drawing.line([[axes.inside.left, bottom], [axes.inside.right, bottom]], Stroke::new(GREY, 1.0));
        for (run, place) in self.runs.iter().zip(&line) {
            if let Some(drift) = run.drift.as_ref().filter(|drift| !drift.is_empty()) {
                labels.place(
                    &mut drawing,
                    TextLine::new(shortened(drift, 12.5, true, 240.0), [0.0, 0.0]).size(12.5).bold(),
                    *place,
                );
            }
        }
        let key = [(COLOURS[0], "no drift"), (COLOURS[1], "drift, and what moved the number")];
        let mut x = axes.inside.left;
        for (colour, text) in key {
            drawing.disc([x + 6.0, bottom + 48.0], 5.0, Fill::solid(colour));
            let text = TextLine { colour: INK, ..TextLine::new(text, [x + 18.0, bottom + 48.0]).size(12.0) };
            x = text.extent().right + 24.0;
            drawing.text(text);
        }
        drawing.rectangle(Extent::new(x, bottom + 41.0, x + 18.0, bottom + 55.0), Fill::faint(COLOURS[2], 0.3));
        drawing.text(TextLine::new("the baseline's limits", [x + 24.0, bottom + 48.0]).size(12.0));
        drawing
    }
}
