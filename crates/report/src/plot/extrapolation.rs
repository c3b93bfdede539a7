use super::drawing::axes::{Axes, AxisText};
use super::drawing::labels::names_above;
use super::drawing::scale::Scale;
use super::drawing::series::{
    Curve, Estimate, QualityMetric, bars, beyond_note, draw_curves, height_of_names, note, number_axis, scale_of,
    sentences,
};
use super::drawing::shape::{Drawing, Extent, Fill, MARGIN};
use super::drawing::theme::{GRID, colour};
use crate::numbers::{signed, with_minus_sign};

/// Quality against the distance from the window of context frames.
#[derive(Clone, Debug)]
pub struct ExtrapolationDecay {
    /// Title.
    pub title: String,
    /// Protocol, scenes.
    pub subtitle: String,
    /// The metric.
    pub quality: QualityMetric,
    /// Frames of distance that one point covers.
    pub step: f64,
    /// A curve per method.
    pub series: Vec<ExtrapolationSeries>,
}

/// One method.
#[derive(Clone, Debug)]
pub struct ExtrapolationSeries {
    /// Its name.
    pub label: String,
    /// Distance from the window in frames, the middle of each step, negative before it and 0 inside, with the mean over
    /// scenes; ascending.
    pub points: Vec<(f64, Estimate)>,
}

impl ExtrapolationDecay {
    /// Draws it: frames before the window on the left, after it on the right.
    pub fn draw(&self) -> Drawing {
        let (mut drawing, head) = Drawing::titled(860, &self.title, &self.subtitle);
        let points = || self.series.iter().flat_map(|series| &series.points);
        let top = head + 58.0;
        let names = height_of_names(self.series.iter().map(|series| series.label.as_str()));
        let axes = Axes {
            inside: Extent::new(64.0, top, 640.0, top + names.clamp(340.0, f64::INFINITY)),
            x: Scale::around(points().map(|(distance, _)| *distance).chain([-1.0, 1.0]), 0.03),
            y: scale_of(points().map(|(_, mean)| mean), 0.1),
        };
        let window = [-0.5, 0.5].map(|edge| axes.x_of(edge));
        drawing.rectangle(Extent { left: window[0], right: window[1], ..axes.inside }, Fill::solid(GRID));
        names_above(&mut drawing, top - 12.0, &[("window of the context frames".to_owned(), window)], [MARGIN, 660.0]);
        axes.draw_y_below(&mut drawing, &number_axis(&self.quality.title()), 26.0);
        let label = |value: f64, _: &[f64]| with_minus_sign(&signed(value, 0));
        let ticks: Vec<f64> = axes.x.ticks(9).into_iter().filter(|tick| tick.fract() == 0.0).collect();
        let title = "frames before (−) and after (+) the window";
        let bottom = axes.draw_x_at(&mut drawing, &AxisText { title, label: &label }, &ticks);
        let curves = self.series.iter().enumerate().map(|(at, series)| Curve {
            label: &series.label,
            points: series.points.clone(),
            colour: colour(at),
        });
        let step = self.step;
        let joined = |a: f64, b: f64| b - a < 1.5 * step && (a * b > 0.0 || step <= 1.0);
        let beyond = draw_curves(&mut drawing, &axes, &curves.collect::<Vec<_>>(), joined);
        let intervals = bars("Bars and bands", points().map(|(_, mean)| mean), false);
        let bottom = note(&mut drawing, bottom, &sentences([&*intervals, &*beyond_note(&beyond, self.quality)]));
        drawing.end_at(bottom + 14.0);
        drawing
    }
}

#[cfg(test)]
mod tests {
    use atsplat_metrics::definition;

    use super::super::drawing::shape::{Role, Shape};
    use super::*;

    /// Inside the window, three methods have the same mean.
    #[test]
    fn a_point_does_not_hide_another() {
        let series = |label: &str, far: f64| ExtrapolationSeries {
            label: label.to_owned(),
            points: vec![(0.0, Estimate::exact(20.0)), (5.0, Estimate::exact(far))],
        };
        let drawing = ExtrapolationDecay {
            title: String::new(),
            subtitle: String::new(),
            quality: definition("psnr").unwrap().into(),
            step: 1.0,
            series: vec![series("a", 19.0), series("b", 17.0), series("c", 18.0)],
        }
        .draw();
        let rings = |label: &str| {
            let of_method = drawing.items.iter().filter(|item| item.role == Role::Data(label.into()));
            of_method.filter(|item| matches!(item.shape, Shape::Ring { .. })).count()
        };
        assert_eq!(["a", "b", "c"].map(rings), [0, 1, 1]);
        // A ring is white inside: it would hide what is drawn before it.
        let marks = drawing.items.iter().filter_map(|item| match item.shape {
            Shape::Ring { centre, radius, .. } | Shape::Disc { centre, radius, .. } => Some((centre[0], radius)),
            _ => None,
        });
        let inside: Vec<(f64, f64)> = marks.collect();
        let first = inside.first().unwrap().0;
        let radii: Vec<f64> =
            inside.iter().filter(|(x, _)| (x - first).abs() < 1e-6).map(|(_, radius)| *radius).collect();
        assert!(radii.len() == 3 && radii.is_sorted_by(|a, b| a > b), "{radii:?}");
    }
}
