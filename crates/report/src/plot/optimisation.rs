use atsplat_numeric::Extremes as _;
use plotters::style::RGBColor;

use super::drawing::axes::{Axes, AxisText};
use super::drawing::labels::names_above;
use super::drawing::scale::{Scale, single_label, time_unit};
use super::drawing::series::{
    Estimate, Origin, QualityMetric, bars, mark, note, number_axis, sentences, whisker, without_interval,
};
use super::drawing::shape::{Drawing, Extent, MARGIN, Stroke};
use super::drawing::theme::colour;

/// Quality against the seconds that a trial's Gaussians were optimised for: held-out targets in the upper row, and in the
/// lower row the context views that they were optimised on, so that overfitting shows.
#[derive(Clone, Debug)]
pub struct OptimisationCurves {
    /// Title.
    pub title: String,
    /// Protocol, scenes, machine.
    pub subtitle: String,
    /// The metric of the held-out targets.
    pub quality: QualityMetric,
    /// Labels in the order of their colours, so that a curve keeps its colour in a plot without the others.
    pub palette: Vec<String>,
    /// Side by side, at most four in a row.
    pub panels: Vec<OptimisationPanel>,
    /// Below the panels, after the meaning of the bars.
    pub note: String,
}

/// The curves for one number of context views.
#[derive(Clone, Debug)]
pub struct OptimisationPanel {
    /// Above the panel: `2 views · 8 scenes`.
    pub name: String,
    /// Curves by label, which is one of the palette's.
    pub curves: Vec<(String, Vec<OptimisationPoint>)>,
}

/// A method with one budget.
#[derive(Clone, Copy, Debug)]
pub struct OptimisationPoint {
    /// Seconds from context images to the first rendered image, above 0.
    pub secs: f64,
    /// The metric on held-out targets.
    pub held_out: Estimate,
    /// PSNR in dB on the context views, of a method that is optimised on them.
    pub context: Option<f64>,
}

/// What a row of panels shows of a point.
type Reading = fn(&OptimisationPoint) -> Option<Estimate>;

/// Height of a panel's inside.
const HEIGHT: f64 = 260.0;
/// Between the insides of two panels.
const GAP: f64 = 56.0;

impl OptimisationCurves {
    /// Draws it.
    pub fn draw(&self) -> Drawing {
        let columns = self.panels.len().clamp(1, 4);
        let width = [760.0, 400.0, 320.0, 280.0][columns - 1];
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a few panels")]
        let (mut drawing, head) =
            Drawing::titled(((width + GAP) * columns as f64) as u32 + 40, &self.title, &self.subtitle);
        let is_drawn =
            |label: &str| self.panels.iter().flat_map(|panel| &panel.curves).any(|(drawn, _)| drawn == label);
        let labels: Vec<&str> = self.palette.iter().map(String::as_str).filter(|label| is_drawn(label)).collect();
        let mut below = drawing.legend(MARGIN, head + 12.0, &labels, |drawing, at, place| {
            mark(drawing, place, Origin::Measured, self.colour_of(labels[at]));
        });
        let points = || self.panels.iter().flat_map(|panel| &panel.curves).flat_map(|(_, points)| points);
        let (unit, length) = time_unit(points().map(|point| point.secs));
        let x = Scale::logarithmic(points().map(|point| point.secs / length), 0.06);
        let x_title = format!("time to the first image in {unit}, logarithmic");
        let x_text = AxisText { title: &x_title, label: &|value, _| single_label(value) };
        let held_out = Scale::around(points().flat_map(|point| point.held_out.extent()), 0.08);
        let context = Scale::around(points().filter_map(|point| point.context), 0.08);
        let mut rows: Vec<(String, Scale, Reading)> =
            vec![(format!("held out: {}", self.quality.title()), held_out, |point| Some(point.held_out))];
        if points().any(|point| point.context.is_some()) {
            let title = "context views: PSNR in dB".to_owned();
            rows.push((title, context, |point| point.context.map(Estimate::exact)));
        }
        for panels in self.panels.chunks(4) {
            let left_of = |at: usize| 64.0 + (width + GAP) * at as f64;
            let inside = |at, top| Extent::new(left_of(at), top, left_of(at) + width - GAP + 36.0, top + HEIGHT);
            let mut top = below + 56.0;
            for (at, panel) in panels.iter().enumerate() {
                let Extent { left, right, .. } = inside(at, top);
                let name = (panel.name.clone(), [left, right]);
                names_above(&mut drawing, top - 30.0, &[name], [left - 40.0, right + 20.0]);
            }
            for (title, y, estimate) in &rows {
                for (at, panel) in panels.iter().enumerate() {
                    let axes = Axes { inside: inside(at, top), x, y: *y };
                    axes.draw_y(&mut drawing, &number_axis(title));
                    below = axes.draw_x(&mut drawing, &x_text).maximum_of(below);
                    for (label, points) in &panel.curves {
                        let estimates = points.iter().filter_map(|point| Some((point.secs / length, estimate(point)?)));
                        let estimates: Vec<(f64, Estimate)> = estimates.collect();
                        curve(&mut drawing, &axes, (label, self.colour_of(label)), &estimates);
                    }
                }
                top = below + 34.0;
            }
        }
        let intervals = bars("Bars", points().map(|point| &point.held_out), false);
        let few = without_interval(points().map(|point| &point.held_out));
        let bottom = note(&mut drawing, below, &sentences([&*intervals, &*few, &*self.note]));
        drawing.end_at(bottom + 14.0);
        drawing
    }

    fn colour_of(&self, label: &str) -> RGBColor {
        colour(self.palette.iter().take_while(|other| *other != label).count())
    }
}

/// A line with a mark and an interval at each point; numbers that are not finite have none.
fn curve(drawing: &mut Drawing, axes: &Axes, (label, colour): (&str, RGBColor), points: &[(f64, Estimate)]) {
    let points: Vec<&(f64, Estimate)> = points.iter().filter(|(x, mean)| (x * mean.value).is_finite()).collect();
    let line: Vec<[f64; 2]> = points.iter().map(|(x, mean)| axes.place(*x, mean.value)).collect();
    drawing.data(label, |drawing| {
        if line.len() > 1 {
            drawing.line(line.clone(), Stroke::new(colour, 2.0));
        }
        for ((_, mean), at) in points.iter().zip(&line) {
            if let Some(interval) = mean.interval {
                let [low, high] = interval.map(|value| axes.y_of(value));
                whisker(drawing, at[0], [low, high], Stroke::new(colour, 1.0));
            }
            mark(drawing, *at, Origin::Measured, colour);
        }
    });
}
