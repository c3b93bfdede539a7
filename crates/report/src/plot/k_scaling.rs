use super::drawing::axes::{Axes, AxisText};
use super::drawing::labels::Labels;
use super::drawing::scale::Scale;
use super::drawing::series::{Estimate, Origin, QualityMetric, bars, mark, note, number_axis, sentences, whisker};
use super::drawing::shape::{Drawing, Extent, MARGIN, Stroke, TextLine};
use super::drawing::theme::{COLOURS, GREY};
use crate::numbers::count_label;

/// Quality against the number of Gaussians per token.
#[derive(Clone, Debug)]
pub struct KScaling {
    /// Title.
    pub title: String,
    /// Protocol, scenes.
    pub subtitle: String,
    /// The metric.
    pub quality: QualityMetric,
    /// Published and measured points, in any order.
    pub points: Vec<KPoint>,
    /// Below the plot, after the meaning of its bars.
    pub note: String,
}

/// One setting of K.
#[derive(Clone, Copy, Debug)]
pub struct KPoint {
    /// Gaussians per token.
    pub k: f64,
    /// The metric.
    pub quality: Estimate,
    /// Gaussians per scene, shown next to the mark.
    pub gaussians: Option<f64>,
    /// Published points are hollow.
    pub origin: Origin,
}

impl KScaling {
    /// Draws it.
    pub fn draw(&self) -> Drawing {
        let (mut drawing, head) = Drawing::titled(760, &self.title, &self.subtitle);
        let series = [(Origin::Published, "published", GREY), (Origin::Measured, "measured", COLOURS[0])];
        let series = series.map(|(origin, name, colour)| {
            let mut points: Vec<&KPoint> = self.points.iter().filter(|point| point.origin == origin).collect();
            points.sort_by(|a, b| a.k.total_cmp(&b.k));
            (points, name, colour)
        });
        let shown: Vec<_> = series.iter().filter(|(points, ..)| !points.is_empty()).collect();
        let names: Vec<&str> = shown.iter().map(|(_, name, _)| *name).collect();
        let bottom = drawing.legend(MARGIN, head + 12.0, &names, |drawing, at, place| {
            if let Some((points, _, colour)) = shown.get(at) {
                mark(drawing, place, points[0].origin, *colour);
            }
        });
        let top = bottom + 34.0;
        let axes = Axes {
            inside: Extent::new(64.0, top, 736.0, top + 320.0),
            x: Scale::logarithmic(self.points.iter().map(|point| point.k), 0.06),
            y: Scale::around(self.points.iter().flat_map(|point| point.quality.extent()), 0.15),
        };
        axes.draw_y(&mut drawing, &number_axis(&self.quality.title()));
        let mut ks: Vec<f64> = self.points.iter().map(|point| point.k).collect();
        ks.sort_by(f64::total_cmp);
        ks.dedup();
        let text = AxisText {
            title: "Gaussians per token, K, logarithmic; at the points: Gaussians per scene",
            label: &|k, _| format!("{k}"),
        };
        let bottom = axes.draw_x_at(&mut drawing, &text, &ks);
        let mut labels = Labels::new(Extent::new(axes.inside.left, top, 752.0, axes.inside.bottom - 2.0));
        for (points, name, colour) in &series {
            let line: Vec<_> = points.iter().map(|point| axes.place(point.k, point.quality.value)).collect();
            labels.avoid_line(&line);
            drawing.data(name, |drawing| {
                if line.len() > 1 {
                    drawing.line(line.clone(), Stroke::new(*colour, 2.0));
                }
                for (point, at) in points.iter().zip(&line) {
                    labels.avoid(*at, 6.0);
                    if let Some(interval) = point.quality.interval {
                        let [low, high] = interval.map(|value| axes.y_of(value));
                        labels.avoid_line(&[[at[0], high], [at[0], low]]);
                        whisker(drawing, at[0], [low, high], Stroke::new(*colour, 1.5));
                    }
                    mark(drawing, *at, point.origin, *colour);
                }
            });
        }
        for point in &self.points {
            let Some(gaussians) = point.gaussians else { continue };
            let text = TextLine::new(count_label(gaussians), [0.0, 0.0]).small();
            let text = if point.origin == Origin::Published { text.muted() } else { text };
            labels.place(&mut drawing, &text, axes.place(point.k, point.quality.value));
        }
        let intervals = bars("Bars", self.points.iter().map(|point| &point.quality), false);
        let bottom = note(&mut drawing, bottom, &sentences([&*intervals, &*self.note]));
        drawing.end_at(bottom + 14.0);
        drawing
    }
}
