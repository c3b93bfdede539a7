use super::axes::Axes;
use super::font::shortened;
use super::labels::spread;
use super::scale::Scale;
use super::series::{Estimate, Figure, Origin, plain};
use super::shape::{Drawing, Extent, Fill, Side, Stroke, TextLine};
use super::theme::{GREY, GRID, colour};

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
        let Extent { top, bottom, right, .. } = axes.inside;
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
        let ends: Vec<f64> = self
            .series
            .iter()
            .map(|series| series.points.last().map_or(0.0, |(_, end)| axes.y_of(end.value)))
            .collect();
        let heights = spread(&ends, 18.0, top + 8.0, bottom - 8.0);
        for (at, series) in self.series.iter().enumerate() {
            let colour = if series.origin == Origin::Published { GREY } else { colour(at) };
            for side in [-1, 1] {
                let part: Vec<_> = series.points.iter().filter(|(distance, _)| distance.signum() != -side).collect();
                let band: Vec<_> =
                    part.iter().filter_map(|(x, e)| e.interval.map(|interval| (*x as f64, interval))).collect();
                if band.len() > 1 {
                    let low = band.iter().map(|(x, [low, _])| axes.place(*x, *low));
                    let high = band.iter().rev().map(|(x, [_, high])| axes.place(*x, *high));
                    drawing.area(low.chain(high).collect::<Vec<_>>(), Fill::faint(colour, 0.16));
                }
                let line: Vec<_> = part.iter().map(|(x, estimate)| axes.place(*x as f64, estimate.value)).collect();
                if line.len() > 1 {
                    drawing.line(line, Stroke::new(colour, 2.0));
                }
            }
            for (x, estimate) in &series.points {
                drawing.disc(axes.place(*x as f64, estimate.value), 3.0, Fill::solid(colour));
            }
            if let (Some((x, end)), Some(height)) = (series.points.last(), heights.get(at)) {
                let end = axes.place(*x as f64, end.value);
                drawing.line([end, [right + 12.0, *height]], Stroke::new(colour, 1.0));
                let room = f64::from(drawing.size().0) - right - 24.0;
                drawing.text(TextLine::new(shortened(&series.label, 13.0, false, room), [right + 16.0, *height]));
            }
        }
        drawing.text(TextLine::new("window", [axes.x_of(0.0), top - 14.0]).size(12.0).muted().side(Side::Middle));
        drawing
    }
}
