use atsplat_metrics::{Definition, Direction};
use plotters::style::RGBColor;
use serde::{Deserialize, Serialize};

use super::axes::{Axes, AxisText};
use super::font::shortened;
use super::labels::spread;
use super::shape::{Drawing, Extent, Fill, Side, Stroke, TextLine};
use super::theme::{GREY, INK, colour};

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
pub struct Figure {
    /// Name in tables: `PSNR`.
    pub name: &'static str,
    /// Unit; empty for plain numbers.
    pub unit: &'static str,
    /// Which direction is better.
    pub direction: Direction,
}

impl Estimate {
    /// A number without uncertainty.
    pub const fn exact(value: f64) -> Self {
        Self { value, interval: None }
    }

    /// The value and the ends of the interval.
    pub(super) fn extent(self) -> impl Iterator<Item = f64> {
        [self.value].into_iter().chain(self.interval.into_iter().flatten())
    }
}

impl From<&Definition> for Figure {
    fn from(definition: &Definition) -> Self {
        Self { name: definition.name, unit: definition.unit, direction: definition.direction }
    }
}

impl Figure {
    /// `PSNR in dB, higher is better`.
    pub(super) fn title(self) -> String {
        let unit = if self.unit.is_empty() { String::new() } else { format!(" in {}", self.unit) };
        let better = match self.direction {
            Direction::Higher => "higher is better",
            Direction::Lower => "lower is better",
        };
        format!("{}{unit}, {better}", self.name)
    }

    /// Whether `a` is better than `b`.
    pub(super) fn better(self, a: f64, b: f64) -> bool {
        match self.direction {
            Direction::Higher => a > b,
            Direction::Lower => a < b,
        }
    }

    /// Formats a value as papers do: decibels with two decimals, other metrics with three.
    pub(super) fn print(self, value: f64) -> String {
        if self.unit == "dB" { format!("{value:.2}") } else { format!("{value:.3}") }
    }
}

/// An axis whose ticks are plain numbers.
pub(super) fn plain(title: &str) -> AxisText<'_> {
    AxisText { title, label: &super::scale::label }
}

/// Draws a vertical error bar.
pub(super) fn whisker(drawing: &mut Drawing, x: f64, [low, high]: [f64; 2], stroke: Stroke) {
    drawing.line([[x, low], [x, high]], stroke);
    for y in [low, high] {
        drawing.line([[x - 3.0, y], [x + 3.0, y]], stroke);
    }
}

/// A curve with its uncertainty.
pub(super) struct Curve<'a> {
    pub(super) label: &'a str,
    pub(super) points: Vec<(f64, Estimate)>,
    pub(super) colour: RGBColor,
}

/// Draws curves with marks, the bands of their intervals, and labels on the right. Between a negative and a positive x, a
/// curve has a gap.
pub(super) fn draw_curves(drawing: &mut Drawing, axes: &Axes, curves: &[Curve<'_>]) {
    for Curve { points, colour, .. } in curves {
        for part in points.chunk_by(|(a, _), (b, _)| *a >= 0.0 || *b <= 0.0) {
            let band: Vec<(f64, [f64; 2])> = part.iter().filter_map(|(x, mean)| Some((*x, mean.interval?))).collect();
            if band.len() > 1 {
                let low = band.iter().map(|(x, [low, _])| axes.place(*x, *low));
                let high = band.iter().rev().map(|(x, [_, high])| axes.place(*x, *high));
                drawing.area(low.chain(high).collect::<Vec<_>>(), Fill::faint(*colour, 0.16));
            }
            let line: Vec<_> = part.iter().map(|(x, mean)| axes.place(*x, mean.value)).collect();
            if line.len() > 1 {
                drawing.line(line, Stroke::new(*colour, 2.0));
            }
        }
        for (x, mean) in points {
            drawing.disc(axes.place(*x, mean.value), 3.0, Fill::solid(*colour));
        }
    }
    let Extent { right, top, bottom, .. } = axes.inside;
    let ends: Vec<(&Curve<'_>, [f64; 2])> = curves
        .iter()
        .filter_map(|curve| curve.points.last().map(|(x, mean)| (curve, axes.place(*x, mean.value))))
        .collect();
    let wanted: Vec<f64> = ends.iter().map(|(_, end)| end[1]).collect();
    let room = f64::from(drawing.width) - right - 24.0;
    for ((curve, end), y) in ends.into_iter().zip(spread(&wanted, 18.0, top + 8.0, bottom - 8.0)) {
        drawing.line([end, [right + 12.0, y]], Stroke::new(curve.colour, 1.0));
        drawing.text(TextLine::new(shortened(curve.label, 13.0, false, room), [right + 16.0, y]));
    }
}

/// The colour of a series by its position; published series are grey.
pub(super) fn series_colour(at: usize, origin: Origin) -> RGBColor {
    if origin == Origin::Published { GREY } else { colour(at) }
}

/// Draws the legend of filled and hollow marks, at the upper right.
pub(super) fn origin_key(drawing: &mut Drawing) {
    let (right, y) = (f64::from(drawing.width) - 24.0, 70.0);
    let paper = TextLine::new("published", [right, y]).size(12.0).side(Side::Right);
    let left = paper.extent().left;
    drawing.ring([left - 10.0, y], 4.5, Stroke::new(GREY, 2.0));
    let own = TextLine::new("measured", [left - 32.0, y]).size(12.0).side(Side::Right);
    drawing.disc([own.extent().left - 10.0, y], 5.0, Fill::solid(INK));
    drawing.text(paper);
    drawing.text(own);
}
