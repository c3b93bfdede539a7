use atsplat_numeric::mean;

use super::drawing::axes::{Axes, AxisText};
use super::drawing::scale::{Scale, bounds, single_label};
use super::drawing::series::number_axis;
use super::drawing::shape::{Drawing, Extent, Fill, MARGIN, Stroke};
use super::drawing::theme::{GREY, colour};
use crate::numbers::count_label;

/// Maximum number of points of a curve, each a mean over consecutive steps.
const POINTS: usize = 200;

/// The learning curve of a training run: loss by term above; with evaluations, PSNR next to that of the nearest context view below.
#[derive(Debug)]
pub struct LearningCurve<'a> {
    /// Title above the plot.
    pub title: &'a str,
    /// Configuration, data, number of steps.
    pub subtitle: &'a str,
    /// Number of each step.
    pub steps: &'a [u64],
    /// Name of each loss term, and its value at each step; `None` for skipped steps, which the lines pass over.
    pub losses: &'a [(&'static str, Vec<Option<f64>>)],
    /// Step, PSNR of the renders and PSNR of the nearest context view in dB, of each evaluation; `None` where that view
    /// cannot be compared, because its size differs. Without any, the lower panel is left out.
    pub evaluations: &'a [(u64, f64, Option<f64>)],
}

/// Title of the upper panel's axis: the total is not the sum of the other curves.
const LOSSES: &str =
    "loss, logarithmic: terms without their weights, intermediate ones summed over the sets; total with all weights";
/// The series of the lower panel.
const SCORES: [&str; 2] = ["renders", "nearest context view"];

impl LearningCurve<'_> {
    /// Draws it. Terms that are never positive are omitted, because the scale is logarithmic.
    pub fn draw(&self) -> Drawing {
        let (mut drawing, head) = Drawing::titled(900, self.title, self.subtitle);
        let curves: Vec<(&str, Vec<(f64, f64)>)> = self
            .losses
            .iter()
            .map(|(name, values)| (*name, curve(self.steps, values)))
            .filter(|(_, points)| !points.is_empty())
            .collect();
        let names: Vec<&str> = curves.iter().map(|(name, _)| *name).collect();
        let top = line_legend(&mut drawing, head + 12.0, &names, colour) + 34.0;
        let last = self.steps.last().copied().into_iter().chain(self.evaluations.last().map(|(step, ..)| *step)).max();
        let x = Scale::linear(0.0, last.unwrap_or(1) as f64 + 1.0);
        let losses = Axes {
            inside: Extent::new(72.0, top, 876.0, top + 300.0),
            x,
            y: Scale::logarithmic(curves.iter().flat_map(|(_, points)| points.iter().map(|(_, loss)| *loss)), 0.05),
        };
        losses.draw_y(&mut drawing, &AxisText { title: LOSSES, label: &|loss, _| single_label(loss) });
        let mut below = losses.draw_x(&mut drawing, &AxisText { title: "steps", label: &step_label });
        for (at, (name, points)) in curves.iter().enumerate() {
            draw_line(&mut drawing, &losses, name, points, colour(at));
        }
        if !self.evaluations.is_empty() {
            below = self.draw_scores(&mut drawing, x, below, colour(curves.len()));
        }
        drawing.end_at(below + 14.0);
        drawing
    }

    /// Draws the lower panel, whose renders have this colour; returns its lower end.
    fn draw_scores(&self, drawing: &mut Drawing, x: Scale, above: f64, of_renders: plotters::style::RGBColor) -> f64 {
        let score_colour = |at: usize| if at == 0 { of_renders } else { GREY };
        let renders = self.evaluations.iter().map(|(step, renders, _)| (*step as f64, *renders)).collect();
        let nearest = self.evaluations.iter().filter_map(|(step, _, nearest)| Some((*step as f64, (*nearest)?)));
        let mut series: Vec<(&str, Vec<(f64, f64)>)> = SCORES.into_iter().zip([renders, nearest.collect()]).collect();
        series.retain(|(_, points)| !points.is_empty());
        let names: Vec<&str> = series.iter().map(|(name, _)| *name).collect();
        let top = line_legend(drawing, above + 20.0, &names, score_colour) + 34.0;
        let values = series.iter().flat_map(|(_, points)| points.iter().map(|(_, psnr)| *psnr));
        let (low, high) = bounds(values).unwrap_or((0.0, 1.0));
        let scores =
            Axes { inside: Extent::new(72.0, top, 876.0, top + 260.0), x, y: Scale::linear(low - 1.0, high + 1.0) };
        scores.draw_y(drawing, &number_axis("PSNR in dB on the same samples, higher is better"));
        let below = scores.draw_x(drawing, &AxisText { title: "steps", label: &step_label });
        for (at, (name, points)) in series.iter().enumerate() {
            draw_line(drawing, &scores, name, points, score_colour(at));
        }
        below
    }
}

fn step_label(step: f64, _others: &[f64]) -> String {
    count_label(step)
}

fn line_legend(
    drawing: &mut Drawing,
    top: f64,
    names: &[&str],
    colour: impl Fn(usize) -> plotters::style::RGBColor,
) -> f64 {
    drawing.legend(MARGIN, top, names, |drawing, at, [x, y]| {
        drawing.line([[x - 8.0, y], [x + 8.0, y]], Stroke::new(colour(at), 2.0));
    })
}

/// A line, or a dot if there is only one point.
fn draw_line(drawing: &mut Drawing, axes: &Axes, name: &str, points: &[(f64, f64)], colour: plotters::style::RGBColor) {
    let finite = points.iter().filter(|(_, value)| value.is_finite());
    let line: Vec<[f64; 2]> = finite.map(|(step, value)| axes.place(*step, *value)).collect();
    drawing.data(name, |drawing| match line.as_slice() {
        [] => {}
        [only] => drawing.disc(*only, 3.0, Fill::solid(colour)),
        _ => drawing.line(line, Stroke::new(colour, 2.0)),
    });
}

/// Means over stretches of steps, at their middles, without skipped steps.
fn curve(steps: &[u64], values: &[Option<f64>]) -> Vec<(f64, f64)> {
    let stretch = steps.len().div_ceil(POINTS).max(1);
    let point = |(steps, values): (&[u64], &[Option<f64>])| {
        let middle = *steps.get(steps.len() / 2)? as f64;
        Some((middle, mean(values.iter().copied().flatten())?))
    };
    steps.chunks(stretch).zip(values.chunks(stretch)).filter_map(point).filter(|(_, value)| *value > 0.0).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_run_without_evaluations_has_no_scores() {
        let losses = [("mse", vec![Some(0.4), None, Some(0.2)])];
        let drawn = |evaluations: &[(u64, f64, Option<f64>)]| {
            let subtitle = "3 steps, 1 of them skipped";
            let curve = LearningCurve { title: "a run", subtitle, steps: &[0, 1, 2], losses: &losses, evaluations };
            let drawing = curve.draw();
            let has = |part: &str| drawing.texts().any(|text| text.contains(part));
            assert!(has("terms without their weights"));
            (has("PSNR"), has("renders"), drawing.size().1)
        };
        let (without, with) = (drawn(&[]), drawn(&[(0, 9.0, None), (3, 17.5, None)]));
        assert_eq!(((without.0, without.1), (with.0, with.1)), ((false, false), (true, true)));
        assert!(without.2 + 200 < with.2, "{without:?} {with:?}");
    }

    #[test]
    fn curves_are_means_without_skipped_steps() {
        let steps: Vec<u64> = (0..400).collect();
        let values: Vec<Option<f64>> = (0u32..400).map(|at| (at % 4 != 1).then_some(f64::from(at % 2 + 1))).collect();
        let points = curve(&steps, &values);
        assert_eq!((points.len(), points[0], points[1]), (200, (1.0, 1.0), (3.0, 1.5)));
    }
}
