//! Checks every plot: nothing is cut off, outside or overprinted; each series has its own colour and an entry in the
//! legend; ticks agree with their axis; intervals are shown only where there are points; the heading says how much data
//! there is.

mod axis;
mod heading;
mod overlap;
mod series;
#[cfg(test)]
mod tests;

use std::collections::BTreeSet;
use std::fmt;

use atsplat_numeric::Extremes as _;

use super::font::without_glyph;
use super::shape::{Drawing, Extent, Item, Role, Shape, TextLine};
use super::theme::{NAME, SMALL, TITLE};

/// Something wrong with a plot.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PlotFault {
    /// What kind of fault.
    pub kind: FaultKind,
    /// Which texts or series, and where.
    pub what: String,
}

/// Kinds of faults.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum FaultKind {
    /// A text or shape outside the plot.
    Outside,
    /// A text that ends in an ellipsis.
    Truncated,
    /// A text over another text, a mark, a line or an image.
    Overprinted,
    /// A text in another size than all others.
    Font,
    /// A text with characters that the font of bitmaps lacks.
    Glyph,
    /// Two series whose colours look alike, a legend of another colour than its series, or a colour outside the palette.
    Colour,
    /// A series without an entry in the legend.
    Unexplained,
    /// A tick with a unit, out of order, or at a wrong place; an axis with a single tick.
    Axis,
    /// An interval where there is no point.
    Band,
    /// No title, or a heading that does not say how much was measured on what.
    Heading,
}

impl fmt::Display for PlotFault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let kind = match self.kind {
            FaultKind::Outside => "outside the plot",
            FaultKind::Truncated => "truncated",
            FaultKind::Overprinted => "overprinted",
            FaultKind::Font => "font",
            FaultKind::Glyph => "not in the font of bitmaps",
            FaultKind::Colour => "colour",
            FaultKind::Unexplained => "not in the legend",
            FaultKind::Axis => "axis",
            FaultKind::Band => "interval without a point",
            FaultKind::Heading => "heading",
        };
        write!(f, "{kind}: {}", self.what)
    }
}

impl Drawing {
    /// What is wrong with the plot; empty for a good one.
    pub fn faults(&self) -> Vec<PlotFault> {
        let texts = texts(self);
        let mut faults = self.placement(&texts);
        faults.extend(overlap::faults(self, &texts));
        faults.extend(series::faults(self));
        faults.extend(axis::faults(&texts));
        faults.extend(heading::faults(self));
        faults
    }

    /// Its texts with characters that the font of bitmaps lacks, and these characters.
    pub(crate) fn texts_without_glyph(&self) -> impl Iterator<Item = (&str, BTreeSet<char>)> {
        let texts = self.items.iter().filter_map(|item| match &item.shape {
            Shape::Text(line) => Some((line.text.as_str(), without_glyph(&line.text, line.bold))),
            _ => None,
        });
        texts.filter(|(_, absent)| !absent.is_empty())
    }

    /// Texts and shapes outside the plot, truncated texts, and texts of another size or without a glyph.
    fn placement(&self, texts: &[Printed<'_>]) -> Vec<PlotFault> {
        let page = Extent::new(-0.5, -0.5, f64::from(self.width) + 0.5, f64::from(self.height) + 0.5);
        let mut faults = Vec::new();
        for Printed { line, extent, .. } in texts {
            let text = &line.text;
            if !page.contains(*extent) {
                faults.push(fault(FaultKind::Outside, format!("“{text}” at {extent:?}")));
            }
            if text.contains('…') {
                faults.push(fault(FaultKind::Truncated, format!("“{text}”")));
            }
            if ![TITLE, NAME, SMALL].iter().any(|size| (size - line.size).abs() < 0.26) {
                faults.push(fault(FaultKind::Font, format!("“{text}” in {} px", line.size)));
            }
            let absent: Vec<String> = without_glyph(text, line.bold).iter().map(char::to_string).collect();
            if !absent.is_empty() {
                faults.push(fault(FaultKind::Glyph, format!("{} in “{text}”", absent.join(", "))));
            }
        }
        for item in self.items.iter().filter(|item| !matches!(item.shape, Shape::Text(_))) {
            if !bounds(item).is_some_and(|extent| page.contains(extent)) {
                faults.push(fault(FaultKind::Outside, format!("a shape of {:?} at {:?}", item.role, bounds(item))));
            }
        }
        faults
    }
}

/// A line of text on the plot.
struct Printed<'a> {
    line: TextLine,
    extent: Extent,
    role: &'a Role,
}

fn texts(drawing: &Drawing) -> Vec<Printed<'_>> {
    let lines = |item: &'_ Item| match &item.shape {
        Shape::Text(text) => text.lines(),
        _ => Vec::new(),
    };
    let printed =
        |item: &'_ Item| lines(item).into_iter().filter(|line| !line.text.trim().is_empty()).collect::<Vec<_>>();
    let all = drawing.items.iter().flat_map(|item| printed(item).into_iter().map(move |line| (line, &item.role)));
    all.map(|(line, role)| Printed { extent: line.extent(), line, role }).collect()
}

/// The bounding box of a shape; `None` if a coordinate is not a number.
fn bounds(item: &Item) -> Option<Extent> {
    let around = |points: &[[f64; 2]]| {
        let first = points.first()?;
        let mut extent = Extent::new(first[0], first[1], first[0], first[1]);
        for [x, y] in points {
            extent = Extent::new(
                x.minimum_of(extent.left),
                y.minimum_of(extent.top),
                x.maximum_of(extent.right),
                y.maximum_of(extent.bottom),
            );
        }
        points.iter().flatten().all(|at| at.is_finite()).then_some(extent)
    };
    match &item.shape {
        Shape::Line { points, .. } => around(points),
        Shape::Area { corners, .. } => around(corners),
        Shape::Disc { centre: [x, y], radius, .. } | Shape::Ring { centre: [x, y], radius, .. } => {
            around(&[[x - radius, y - radius], [x + radius, y + radius]])
        }
        Shape::Image { at, .. } => Some(*at),
        Shape::Text(text) => Some(text.extent()),
    }
}

fn fault(kind: FaultKind, what: String) -> PlotFault {
    PlotFault { kind, what }
}
