use super::drawing::axes::{Axes, AxisText};
use super::drawing::labels::names_above;
use super::drawing::scale::Scale;
use super::drawing::series::{
    Curve, Estimate, QualityMetric, bars, beyond_note, draw_curves, height_of_names, note, number_axis, scale_of,
    sentences, without_interval,
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
    /// In the order of their distances.
    pub points: Vec<ExtrapolationPoint>,
}

/// The mean of one step of distances.
#[derive(Clone, Copy, Debug)]
pub struct ExtrapolationPoint {
    /// Distance from the window in frames, the middle of the step, negative before the window and 0 inside.
    pub distance: f64,
    /// The mean over scenes.
    pub mean: Estimate,
    /// Number of scenes in it.
    pub scenes: u64,
}

/// A line joins points of at least so many scenes: between others, it would show how scenes differ.
const JOINED_SCENES: u64 = 3;

impl ExtrapolationDecay {
    /// Draws it: frames before the window on the left, after it on the right.
    pub fn draw(&self) -> Drawing {
        let (mut drawing, head) = Drawing::titled(860, &self.title, &self.subtitle);
        let points = || self.series.iter().flat_map(|series| &series.points);
        let top = head + 58.0;
        let names = height_of_names(self.series.iter().map(|series| series.label.as_str()));
        let axes = Axes {
            inside: Extent::new(64.0, top, 640.0, top + names.clamp(340.0, f64::INFINITY)),
            x: Scale::around(points().map(|point| point.distance).chain([-1.0, 1.0]), 0.03),
            y: scale_of(points().map(|point| &point.mean), 0.1),
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
            points: series.points.iter().map(|point| (point.distance, point.mean)).collect(),
            colour: colour(at),
        });
        let step = self.step;
        let few: Vec<f64> = points().filter(|point| point.scenes < JOINED_SCENES).map(|point| point.distance).collect();
        let has_few = |distance: f64| few.iter().any(|few| few.total_cmp(&distance).is_eq());
        let joined = |a: f64, b: f64| b - a < 1.5 * step && (a * b > 0.0 || step <= 1.0) && !has_few(a) && !has_few(b);
        let beyond = draw_curves(&mut drawing, &axes, &curves.collect::<Vec<_>>(), joined);
        let intervals = bars("Bars and bands", points().map(|point| &point.mean), false);
        let alone = if few.is_empty() { "" } else { "Points of fewer than three scenes are not joined." };
        let unsure = without_interval(points().map(|point| &point.mean));
        let beyond = beyond_note(&beyond, self.quality);
        let bottom = note(&mut drawing, bottom, &sentences([&*intervals, &*unsure, alone, &*beyond]));
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
            points: [(0.0, 20.0), (5.0, far)]
                .map(|(distance, mean)| ExtrapolationPoint { distance, mean: Estimate::exact(mean), scenes: 8 })
                .to_vec(),
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

    /// Of four points in a row, the third is of two scenes in one method's curve.
    #[test]
    fn points_of_few_scenes_are_not_joined() {
        let series = |label: &str, third: u64| ExtrapolationSeries {
            label: label.to_owned(),
            points: [(1.0, 8), (2.0, 3), (3.0, third), (4.0, 8)]
                .map(|(distance, scenes)| ExtrapolationPoint {
                    distance,
                    mean: Estimate::exact(20.0 - distance),
                    scenes,
                })
                .to_vec(),
        };
        let drawn = |third| {
            let plot = ExtrapolationDecay {
                title: String::new(),
                subtitle: String::new(),
                quality: definition("psnr").unwrap().into(),
                step: 1.0,
                series: vec![series("a", 3), series("b", third)],
            };
            let drawing = plot.draw();
            let is_said = drawing.texts().any(|text| text == "Points of fewer than three scenes are not joined.");
            let corners = drawing.items.iter().filter_map(|item| match &item.shape {
                Shape::Line { points, .. } if matches!(item.role, Role::Data(_)) => Some(points.len()),
                _ => None,
            });
            (corners.collect::<Vec<_>>(), is_said)
        };
        assert_eq!(drawn(3), (vec![4, 4], false));
        assert_eq!(drawn(2), (vec![2, 2], true));
    }
}
