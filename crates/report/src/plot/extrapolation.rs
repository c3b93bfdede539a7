use super::axes::Axes;
use super::scale::Scale;
use super::series::{Curve, Estimate, Figure, Origin, draw_curves, plain, series_colour};
use super::shape::{Drawing, Extent, Fill, Side, TextLine};
use super::theme::GRID;

/// Quality against the distance from the window of context frames.
#[derive(Clone, Debug)]
pub struct ExtrapolationDecay {
    /// Title.
    pub title: String,
    /// Protocol, scenes.
    pub subtitle: String,
    /// The metric.
    pub quality: Figure,
    /// A curve per method.
    pub series: Vec<ExtrapolationSeries>,
}

/// One method.
#[derive(Clone, Debug)]
pub struct ExtrapolationSeries {
    /// Its name.
    pub label: String,
    /// Distance from the window in frames, negative before it and 0 inside, with the mean over scenes; ascending.
    pub points: Vec<(i64, Estimate)>,
    /// Published series are grey.
    pub origin: Origin,
}

impl ExtrapolationDecay {
    /// Draws it: frames before the window on the left, after it on the right.
    pub fn draw(&self) -> Drawing {
        let mut drawing = Drawing::new(860, 500);
        drawing.heading(&self.title, &self.subtitle);
        let distances =
            self.series.iter().flat_map(|series| series.points.iter().map(|(distance, _)| *distance as f64));
        let values =
            self.series.iter().flat_map(|series| series.points.iter().flat_map(|(_, estimate)| estimate.extent()));
        let axes = Axes {
            inside: Extent::new(64.0, 100.0, 640.0, 440.0),
            x: Scale::around(distances.chain([-1.0, 1.0]), 0.03),
            y: Scale::around(values, 0.1),
        };
        let Extent { top, bottom, .. } = axes.inside;
        let window = Extent::new(axes.x_of(-0.5), top, axes.x_of(0.5), bottom);
        drawing.rectangle(window, Fill::solid(GRID));
        axes.draw_y(&mut drawing, &plain(&self.quality.title()));
        let label = |value: f64, _: &[f64]| {
            if value > 0.0 { format!("+{value:.0}") } else { format!("{value:.0}").replace('-', "−") }
        };
        let ticks: Vec<f64> = axes.x.ticks(9).into_iter().filter(|tick| tick.fract() == 0.0).collect();
        let text =
            super::axes::AxisText { title: "frames outside the window of context frames; 0 is inside", label: &label };
        axes.draw_x_at(&mut drawing, &text, &ticks);
        let curves = self.series.iter().enumerate().map(|(at, series)| Curve {
            label: &series.label,
            points: series.points.iter().map(|(distance, mean)| (*distance as f64, *mean)).collect(),
            colour: series_colour(at, series.origin),
        });
        draw_curves(&mut drawing, &axes, &curves.collect::<Vec<_>>());
        drawing.text(TextLine::new("window", [axes.x_of(0.0), top - 14.0]).size(12.0).muted().side(Side::Middle));
        drawing
    }
}
