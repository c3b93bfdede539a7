use atsplat_metrics::{Definition, Direction};
use serde::{Deserialize, Serialize};

use super::axes::AxisText;
use super::shape::{Drawing, Fill, Side, Stroke, TextLine};
use super::theme::{GREY, INK};

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
