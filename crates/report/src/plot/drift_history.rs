use atsplat_numeric::Extremes as _;

use super::drawing::axes::Axes;
use super::drawing::labels::Labels;
use super::drawing::scale::Scale;
use super::drawing::series::{QualityMetric, number_axis};
use super::drawing::shape::{Drawing, Extent, Fill, MARGIN, Role, Side, Stroke, TextLine};
use super::drawing::theme::{COLOURS, GREY};

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
    pub quality: QualityMetric,
    /// Runs, oldest first.
    pub runs: Vec<DriftRun>,
}

/// One run.
#[derive(Clone, Debug)]
pub struct DriftRun {
    /// Commit, date, or another text that distinguishes runs.
    pub label: String,
    /// The mean over scenes. Their interval is not drawn: it is how much scenes differ, which hides a change that all share.
    pub mean: f64,
    /// The baseline's limits: low, high.
    pub limits: Option<[f64; 2]>,
    /// If drift was found: what moved the number, or an empty text if an earlier run states it.
    pub drift: Option<String>,
}

impl DriftHistory {
    /// Draws it.
    pub fn draw(&self) -> Drawing {
        let (mut drawing, head) = Drawing::titled(860, &self.title, &self.subtitle);
        let drifted = self.runs.iter().any(|run| run.drift.is_some());
        let limited = self.runs.iter().any(|run| run.limits.is_some());
        let keys = [(SAME, true), (MOVED, drifted), (LIMITS, limited)];
        let keys: Vec<&str> = keys.iter().filter(|(_, is_used)| *is_used).map(|(name, _)| *name).collect();
        let bottom = drawing.legend(MARGIN, head + 12.0, &keys, |drawing, at, place| match keys[at] {
            SAME => drawing.disc(place, 4.5, Fill::solid(COLOURS[0])),
            MOVED => drawing.disc(place, 6.0, Fill::solid(COLOURS[1])),
            _ => drawing.swatch(place, Fill::faint(COLOURS[2], 0.3)),
        });
        let top = bottom + 34.0;
        let values = self.runs.iter().flat_map(|run| [run.mean].into_iter().chain(run.limits.into_iter().flatten()));
        let axes = Axes {
            inside: Extent::new(72.0, top, 836.0, top + 280.0),
            x: Scale::linear(-0.5, self.runs.len() as f64 - 0.5),
            y: Scale::around(values, 0.12),
        };
        axes.draw_y(&mut drawing, &number_axis(&self.quality.title()));
        let Extent { left, right, bottom, .. } = axes.inside;
        self.draw_limits(&mut drawing, &axes);
        let places: Vec<[f64; 2]> =
            self.runs.iter().enumerate().map(|(at, run)| axes.place(at as f64, run.mean)).collect();
        if places.len() > 1 {
            drawing.line(places.clone(), Stroke::new(GREY, 1.5));
        }
        drawing.with(Role::Frame, |drawing| drawing.line([[left, bottom], [right, bottom]], Stroke::new(GREY, 1.0)));
        let mut labels = Labels::new(Extent::new(left, top - 4.0, 856.0, bottom - 4.0));
        labels.avoid_line(&places);
        let room = axes.inside.width() / self.runs.len().clamp(1, usize::MAX) as f64;
        let every = (64.0 / room).ceil().clamp(1.0, 1e6);
        let mut below = bottom;
        for (at, (run, place)) in self.runs.iter().zip(&places).enumerate() {
            drawing.data(if run.drift.is_some() { MOVED } else { SAME }, |drawing| {
                let (radius, colour) = if run.drift.is_some() { (7.0, COLOURS[1]) } else { (4.5, COLOURS[0]) };
                drawing.disc(*place, radius, Fill::solid(colour));
            });
            labels.avoid(*place, 8.0);
            if (at as f64 / every).fract() == 0.0 {
                let name = TextLine::new(&*run.label, [place[0], 0.0]).small().muted().side(Side::Middle);
                let name = name.within((room * every - 6.0).minimum_of(120.0)).below(bottom + 10.0);
                below = below.maximum_of(name.extent().bottom);
                drawing.text(name);
            }
        }
        for (run, place) in self.runs.iter().zip(&places) {
            if let Some(drift) = run.drift.as_ref().filter(|drift| !drift.is_empty()) {
                let text = TextLine::new(&**drift, [0.0, 0.0]).small().bold().within(240.0);
                labels.place(&mut drawing, &text, *place);
            }
        }
        drawing.end_at(below + 16.0);
        drawing
    }

    /// A band for each stretch of runs with the same limits.
    fn draw_limits(&self, drawing: &mut Drawing, axes: &Axes) {
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
    }
}

const SAME: &str = "no drift";
const MOVED: &str = "drift, and what moved the number";
const LIMITS: &str = "limits of the baseline";
