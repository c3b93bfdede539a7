use super::axes::{Axes, AxisText};
use super::labels::Labels;
use super::scale::{Scale, count_label};
use super::series::{Estimate, Figure, Origin, origin_key, plain, whisker};
use super::shape::{Drawing, Extent, Fill, Stroke, TextLine};
use super::theme::{COLOURS, GREY};

/// Quality against the number of Gaussians per token.
#[derive(Clone, Debug)]
pub struct KScaling {
    /// Title.
    pub title: String,
    /// Protocol, scenes.
    pub subtitle: String,
    /// The metric.
    pub quality: Figure,
    /// Published and measured points, in any order.
    pub points: Vec<KPoint>,
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
        let mut drawing = Drawing::new(760, 480);
        drawing.heading(&self.title, &self.subtitle);
        let axes = Axes {
            inside: Extent::new(64.0, 100.0, 736.0, 420.0),
            x: Scale::logarithmic(self.points.iter().map(|point| point.k), 0.06),
            y: Scale::around(self.points.iter().flat_map(|point| point.quality.extent()), 0.15),
        };
        axes.draw_y(&mut drawing, &plain(&self.quality.title()));
        let mut ks: Vec<f64> = self.points.iter().map(|point| point.k).collect();
        ks.sort_by(f64::total_cmp);
        ks.dedup();
        let text = AxisText {
            title: "Gaussians per token, K, logarithmic; labels: Gaussians per scene",
            label: &|k, _| format!("{k}"),
        };
        axes.draw_x_at(&mut drawing, &text, &ks);
        origin_key(&mut drawing);
        let mut labels = Labels::new(Extent::new(axes.inside.left, 84.0, 752.0, axes.inside.bottom - 2.0));
        for (origin, colour) in [(Origin::Published, GREY), (Origin::Measured, COLOURS[0])] {
            let mut points: Vec<&KPoint> = self.points.iter().filter(|point| point.origin == origin).collect();
            points.sort_by(|a, b| a.k.total_cmp(&b.k));
            let line: Vec<_> = points.iter().map(|point| axes.place(point.k, point.quality.value)).collect();
            labels.avoid_line(&line);
            if line.len() > 1 {
                drawing.line(line.clone(), Stroke::new(colour, 2.0));
            }
            for (point, at) in points.iter().zip(line) {
                labels.avoid(at, 6.0);
                if let Some(interval) = point.quality.interval {
                    let [low, high] = interval.map(|value| axes.y_of(value));
                    labels.avoid_line(&[[at[0], high], [at[0], low]]);
                    whisker(&mut drawing, at[0], [low, high], Stroke::new(colour, 1.5));
                }
                match origin {
                    Origin::Published => drawing.ring(at, 5.0, Stroke::new(colour, 2.0)),
                    Origin::Measured => drawing.disc(at, 6.0, Fill::solid(colour)),
                }
            }
        }
        for point in &self.points {
            let Some(gaussians) = point.gaussians else { continue };
            let text = TextLine::new(count_label(gaussians), [0.0, 0.0]).size(12.0);
            let text = if point.origin == Origin::Published { text.muted() } else { text };
            labels.place(&mut drawing, text, axes.place(point.k, point.quality.value));
        }
        drawing
    }
}
