use std::cmp::Reverse;

use atsplat_metrics::{Definition, Direction};
use atsplat_results::statistics::MIN_SCENES;
use plotters::style::RGBColor;
use serde::{Deserialize, Serialize};

use super::axes::{Axes, AxisText};
use super::labels::spread;
use super::scale::Scale;
use super::shape::{Drawing, Extent, Fill, MARGIN, Role, Stroke, TextLine};

/// The origin of a number.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Origin {
    /// Printed in a paper.
    Published,
    /// Measured by this toolkit.
    Measured,
}

/// A mean with its uncertainty, if known.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Estimate {
    /// The mean.
    pub value: f64,
    /// 95 % interval: low, high.
    pub interval: Option<[f64; 2]>,
}

/// The metric of a quality axis.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct QualityMetric {
    /// Name in tables: `PSNR`.
    pub name: &'static str,
    /// Unit; empty for plain numbers.
    pub unit: &'static str,
    /// Which direction is better.
    pub direction: Direction,
    /// The decimals that papers print.
    pub decimals: usize,
}

impl Estimate {
    /// A number without uncertainty.
    pub const fn exact(value: f64) -> Self {
        Self { value, interval: None }
    }

    /// The value and the ends of the interval.
    pub(in crate::plot) fn extent(self) -> impl Iterator<Item = f64> {
        [self.value].into_iter().chain(self.interval.into_iter().flatten())
    }
}

impl From<&Definition> for QualityMetric {
    fn from(definition: &Definition) -> Self {
        let Definition { name, unit, direction, scale, .. } = *definition;
        Self { name, unit, direction, decimals: scale.decimals() }
    }
}

impl QualityMetric {
    /// `PSNR in dB`, `SSIM`.
    pub(in crate::plot) fn name_with_unit(self) -> String {
        if self.unit.is_empty() { self.name.to_owned() } else { format!("{} in {}", self.name, self.unit) }
    }

    /// `PSNR in dB, higher is better`.
    pub(in crate::plot) fn title(self) -> String {
        let better = match self.direction {
            Direction::Higher => "higher is better",
            Direction::Lower => "lower is better",
        };
        format!("{}, {better}", self.name_with_unit())
    }

    /// Whether `a` is better than `b`.
    pub(in crate::plot) fn better(self, a: f64, b: f64) -> bool {
        match self.direction {
            Direction::Higher => a > b,
            Direction::Lower => a < b,
        }
    }

    /// Formats a value as papers do: decibels with two decimals, other metrics with three.
    pub(in crate::plot) fn print(self, value: f64) -> String {
        let decimals = self.decimals;
        format!("{value:.decimals$}")
    }
}

/// An axis whose ticks are plain numbers.
pub(in crate::plot) fn number_axis(title: &str) -> AxisText<'_> {
    AxisText { title, label: &super::scale::label }
}

/// Draws a vertical error bar.
pub(in crate::plot) fn whisker(drawing: &mut Drawing, x: f64, [low, high]: [f64; 2], stroke: Stroke) {
    drawing.line([[x, low], [x, high]], stroke);
    for y in [low, high] {
        drawing.line([[x - 3.0, y], [x + 3.0, y]], stroke);
    }
}

/// Draws a horizontal error bar.
pub(in crate::plot) fn level_whisker(drawing: &mut Drawing, y: f64, [low, high]: [f64; 2], stroke: Stroke) {
    drawing.line([[low, y], [high, y]], stroke);
    for x in [low, high] {
        drawing.line([[x, y - 4.0], [x, y + 4.0]], stroke);
    }
}

/// A curve with its uncertainty.
pub(in crate::plot) struct Curve<'a> {
    pub(in crate::plot) label: &'a str,
    pub(in crate::plot) points: Vec<(f64, Estimate)>,
    pub(in crate::plot) colour: RGBColor,
}

/// Width of the names at the right ends of curves.
pub(in crate::plot) const NAMES: f64 = 196.0;

/// The least height of a plot that has room for these names at the ends of its curves.
pub(in crate::plot) fn height_of_names<'a>(names: impl Iterator<Item = &'a str>) -> f64 {
    names.map(|name| name_of(name).height() + BETWEEN).sum()
}

/// Pixels between two names.
const BETWEEN: f64 = 5.0;

fn name_of(name: &str) -> TextLine {
    TextLine::new(name, [0.0; 2]).within(NAMES)
}

/// Draws curves with marks, the bands of their intervals, and names on the right. Lines and bands only join points that
/// `joined` says are neighbours; a point's interval without a neighbour's is an error bar. A point at the place of another is a ring
/// around it. Returns the labels and means of points beyond the scale.
pub(in crate::plot) fn draw_curves(
    drawing: &mut Drawing,
    axes: &Axes,
    curves: &[Curve<'_>],
    joined: impl Fn(f64, f64) -> bool,
) -> Vec<(String, f64)> {
    let Extent { right, top, bottom, .. } = axes.inside;
    let kept = |y: f64| y.clamp(top, bottom);
    let is_shown = |mean: f64| (top - 0.5..=bottom + 0.5).contains(&axes.y_of(mean));
    let mut beyond = Vec::new();
    let mut are_rings = draw_rings(drawing, curves, |(x, mean)| {
        let at = [axes.x_of(*x), kept(axes.y_of(mean.value))];
        is_shown(mean.value).then_some(at)
    })
    .into_iter();
    for Curve { points, colour, label } in curves {
        for part in points.chunk_by(|(a, _), (b, _)| joined(*a, *b)) {
            for part in part.chunk_by(|(_, a), (_, b)| has_band(a, is_shown) && has_band(b, is_shown)) {
                draw_intervals(drawing, axes, label, part, *colour);
            }
            let line: Vec<_> = part.iter().map(|(x, mean)| [axes.x_of(*x), kept(axes.y_of(mean.value))]).collect();
            if line.len() > 1 {
                drawing.data(label, |drawing| drawing.line(line, Stroke::new(*colour, 2.0)));
            }
        }
        for (x, mean) in points {
            let at = [axes.x_of(*x), kept(axes.y_of(mean.value))];
            if is_shown(mean.value) {
                if are_rings.next() == Some(false) {
                    drawing.data(label, |drawing| drawing.disc(at, 3.0, Fill::solid(*colour)));
                }
            } else {
                let tip = if at[1] <= top { -7.0 } else { 7.0 };
                let corners = [[at[0] - 5.0, at[1] - tip], [at[0], at[1]], [at[0] + 5.0, at[1] - tip]];
                drawing.data(label, |drawing| drawing.area(corners, Fill::solid(*colour)));
                beyond.push(((*label).to_owned(), mean.value));
            }
        }
    }
    let ends: Vec<(&Curve<'_>, [f64; 2])> = curves
        .iter()
        .filter_map(|curve| {
            let (x, mean) = curve.points.last()?;
            Some((curve, [axes.x_of(*x), kept(axes.y_of(mean.value))]))
        })
        .collect();
    let wanted: Vec<(f64, f64)> =
        ends.iter().map(|(curve, end)| (end[1], name_of(curve.label).height() + BETWEEN)).collect();
    for ((curve, end), y) in ends.into_iter().zip(spread(&wanted, top, bottom)) {
        drawing.key(curve.label, |drawing| {
            drawing.line([end, [right + 12.0, y]], Stroke::new(curve.colour, 1.0));
            drawing.text(TextLine { at: [right + 16.0, y], ..name_of(curve.label) });
        });
    }
    beyond
}

/// Draws a ring for each point at the place of earlier ones, the largest first, because a ring is white inside. Returns which of the
/// points that `place` shows are rings.
fn draw_rings(
    drawing: &mut Drawing,
    curves: &[Curve<'_>],
    place: impl Fn(&(f64, Estimate)) -> Option<[f64; 2]>,
) -> Vec<bool> {
    let mut marks: Vec<([f64; 2], usize, &Curve<'_>)> = Vec::new();
    for curve in curves {
        for at in curve.points.iter().filter_map(&place) {
            let below = marks.iter().filter(|(other, ..)| (at[0] - other[0]).hypot(at[1] - other[1]) < 2.0).count();
            marks.push((at, below, curve));
        }
    }
    let are_rings = marks.iter().map(|(_, below, _)| *below > 0).collect();
    marks.sort_by_key(|(_, below, _)| Reverse(*below));
    for (at, below, curve) in marks.into_iter().take_while(|(_, below, _)| *below > 0) {
        let stroke = Stroke::new(curve.colour, 1.5);
        drawing.data(curve.label, |drawing| drawing.ring(at, 3.0 + 2.5 * below as f64, stroke));
    }
    are_rings
}

/// Whether a point can be part of a band.
fn has_band(mean: &Estimate, is_shown: impl Fn(f64) -> bool) -> bool {
    mean.interval.is_some() && is_shown(mean.value)
}

/// The intervals of neighbouring points that all have one: a band, or the error bar of a single point.
fn draw_intervals(drawing: &mut Drawing, axes: &Axes, label: &str, part: &[(f64, Estimate)], colour: RGBColor) {
    let Extent { top, bottom, .. } = axes.inside;
    let ends = |(x, mean): &(f64, Estimate)| {
        let [low, high] = mean.interval?.map(|value| axes.y_of(value).clamp(top, bottom));
        Some((axes.x_of(*x), [low, high]))
    };
    let band: Vec<(f64, [f64; 2])> = part.iter().filter_map(ends).collect();
    match band.as_slice() {
        [] => {}
        [(x, ends)] => drawing.data(label, |drawing| whisker(drawing, *x, *ends, Stroke::new(colour, 1.5))),
        several => {
            let low = several.iter().map(|(x, [low, _])| [*x, *low]);
            let high = several.iter().rev().map(|(x, [_, high])| [*x, *high]);
            let corners: Vec<[f64; 2]> = low.chain(high).collect();
            drawing.with(Role::Band(label.into()), |drawing| drawing.area(corners, Fill::faint(colour, 0.16)));
        }
    }
}

/// A scale around curves: as wide as the means and intervals without outliers.
pub(in crate::plot) fn scale_of<'a>(curves: impl Iterator<Item = &'a Estimate> + Clone, margin: f64) -> Scale {
    Scale::without_outliers(curves.clone().map(|mean| mean.value), curves.flat_map(|mean| mean.extent()), margin)
}

/// Where the means are that [`draw_curves`] could only point to.
pub(in crate::plot) fn beyond_note(beyond: &[(String, f64)], quality: QualityMetric) -> String {
    if beyond.is_empty() {
        return String::new();
    }
    let means: Vec<String> = beyond.iter().map(|(label, mean)| format!("{label} {}", quality.print(*mean))).collect();
    format!("▲▼ beyond the scale: {}.", means.join(", "))
}

/// What error bars mean: those of `means`, which the plot calls `what`, and horizontal ones of times. Empty for those that are
/// not drawn.
pub(in crate::plot) fn bars<'a>(what: &str, means: impl IntoIterator<Item = &'a Estimate>, has_times: bool) -> String {
    let has_interval = means.into_iter().any(|mean| mean.interval.is_some());
    let intervals = if has_interval { format!("{what}: 95 % intervals over scenes.") } else { String::new() };
    let times = if has_times { "Horizontal bars: quartiles of the time." } else { "" };
    sentences([&*intervals, times])
}

/// Why some of these means over scenes have no interval where others have one; empty if all or none have.
pub(in crate::plot) fn without_interval<'a>(means: impl IntoIterator<Item = &'a Estimate>) -> String {
    let (with, without): (Vec<&Estimate>, Vec<&Estimate>) = means.into_iter().partition(|mean| mean.interval.is_some());
    if with.is_empty() || without.is_empty() {
        return String::new();
    }
    format!("Points of fewer than {MIN_SCENES} scenes have no interval.")
}

/// The sentences that are not empty, one after the other.
pub(in crate::plot) fn sentences<'a>(all: impl IntoIterator<Item = &'a str>) -> String {
    all.into_iter().filter(|sentence| !sentence.is_empty()).collect::<Vec<_>>().join(" ")
}

/// A note below a plot; returns its lower edge.
pub(in crate::plot) fn note(drawing: &mut Drawing, top: f64, text: &str) -> f64 {
    if text.is_empty() {
        return top;
    }
    let room = f64::from(drawing.size().0) - 2.0 * MARGIN;
    let text = TextLine::new(text, [MARGIN, 0.0]).small().muted().within(room).below(top + 8.0);
    let bottom = text.extent().bottom;
    drawing.text(text);
    bottom
}

/// A mark in a series' colour: published hollow, measured filled.
pub(in crate::plot) fn mark(drawing: &mut Drawing, at: [f64; 2], origin: Origin, colour: RGBColor) {
    match origin {
        Origin::Published => drawing.ring(at, 4.5, Stroke::new(colour, 2.0)),
        Origin::Measured => drawing.disc(at, 5.0, Fill::solid(colour)),
    }
}

#[cfg(test)]
mod tests {
    use atsplat_metrics::definition;

    use super::*;

    #[test]
    fn a_missing_interval_is_explained_beside_others() {
        let (with, without) = (Estimate { value: 20.0, interval: Some([19.0, 21.0]) }, Estimate::exact(20.0));
        assert_eq!(without_interval(&[with, without, with]), "Points of fewer than 6 scenes have no interval.");
        assert_eq!(without_interval(&[with, with]), "");
        assert_eq!(without_interval(&[without, without]), "");
    }

    #[test]
    fn means_beyond_the_scale_have_the_digits_of_their_metric() {
        let note = |metric: &str, mean: f64| {
            beyond_note(&[("a".to_owned(), mean), ("b".to_owned(), 2.0 * mean)], definition(metric).unwrap().into())
        };
        assert_eq!(note("ssim", 0.0412), "▲▼ beyond the scale: a 0.041, b 0.082.");
        assert_eq!(note("psnr", 12.345), "▲▼ beyond the scale: a 12.35, b 24.69.");
        assert_eq!(beyond_note(&[], definition("psnr").unwrap().into()), "");
    }
}
