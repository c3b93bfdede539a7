use std::collections::BTreeMap;

use atsplat_numeric::Extremes as _;
use plotters::style::RGBColor;

use super::super::shape::{Drawing, Item, Role, Shape};
use super::super::theme::{in_palette, look_alike};
use super::{FaultKind, PlotFault, fault};

/// Distances in pixels below which two places are the same.
const SAME: f64 = 0.75;

/// Series whose colours look alike, use one outside the palette, are missing from the legend, or have bands where they have no
/// points.
pub(super) fn faults(drawing: &Drawing) -> Vec<PlotFault> {
    let mut faults = Vec::new();
    let mut data = BTreeMap::<&str, Vec<&Item>>::new();
    let mut keys = BTreeMap::<&str, Vec<&Item>>::new();
    for item in &drawing.items {
        match &item.role {
            Role::Data(name) => data.entry(name).or_default().push(item),
            Role::Key(name) => keys.entry(name).or_default().push(item),
            _ => {}
        }
    }
    let mut owners: Vec<(RGBColor, &str)> = Vec::new();
    for (name, items) in &data {
        let mut colours: Vec<RGBColor> = items.iter().filter_map(|item| colour_of(item)).collect();
        colours.sort_by_key(|colour| rgb(*colour));
        colours.dedup();
        for colour in &colours {
            let alike = owners.iter().find(|(known, other)| other != name && look_alike(*known, *colour));
            if let Some((known, other)) = alike {
                let what = format!("“{other}” and “{name}” look alike: {known:?} and {colour:?}");
                faults.push(fault(FaultKind::Colour, what));
            }
            owners.push((*colour, *name));
            if !in_palette(*colour) {
                faults.push(fault(FaultKind::Colour, format!("“{name}” is {colour:?}, which is not in the palette")));
            }
        }
        match keys.get(name) {
            None => faults.push(fault(FaultKind::Unexplained, format!("“{name}”"))),
            Some(key) => {
                let wrong = key.iter().filter_map(|item| colour_of(item)).find(|colour| !colours.contains(colour));
                faults.extend(wrong.map(|colour| {
                    fault(
                        FaultKind::Colour,
                        format!("the legend shows “{name}” as {colour:?}, the plot as {colours:?}"),
                    )
                }));
            }
        }
    }
    faults.extend(drawing.items.iter().filter_map(|item| band(item, &data)));
    faults
}

/// An interval's area that is not between points of its series that a line joins.
fn band(item: &Item, data: &BTreeMap<&str, Vec<&Item>>) -> Option<PlotFault> {
    let Role::Band(name) = &item.role else { return None };
    let found = |what: String| Some(fault(FaultKind::Band, format!("“{name}” {what}")));
    let of_series = data.get(&**name).map_or(&[][..], Vec::as_slice);
    let points = places(of_series.iter().filter_map(|item| mark(item)));
    let edges = edges(item);
    if let Some(edge) = edges.iter().find(|edge| !points.iter().any(|point| (*point - **edge).abs() < SAME)) {
        return found(format!("has an interval at x = {edge:.1} px, but no point"));
    }
    let inside =
        |point: &&f64| edges.first().is_some_and(|low| low < point) && edges.last().is_some_and(|high| *point < high);
    if let Some(point) =
        points.iter().filter(inside).find(|point| !edges.iter().any(|edge| (*edge - **point).abs() < SAME))
    {
        return found(format!("has an interval across x = {point:.1} px, whose point has none"));
    }
    let lines: Vec<[f64; 2]> = of_series.iter().filter_map(|item| span(item)).collect();
    let is_joined = |pair: &[f64]| lines.iter().any(|[low, high]| low - SAME < pair[0] && pair[1] < high + SAME);
    let gap = edges.windows(2).find(|pair| !is_joined(pair))?;
    found(format!("has an interval across a gap from x = {:.1} to {:.1} px", gap[0], gap[1]))
}

/// Where a band has corners.
fn edges(item: &Item) -> Vec<f64> {
    match &item.shape {
        Shape::Area { corners, .. } => places(corners.iter().map(|[x, _]| *x)),
        _ => Vec::new(),
    }
}

/// Ascending, each once.
fn places(all: impl Iterator<Item = f64>) -> Vec<f64> {
    let mut places: Vec<f64> = all.collect();
    places.sort_by(f64::total_cmp);
    places.dedup_by(|a, b| (*a - *b).abs() < SAME);
    places
}

/// From where to where a line goes.
fn span(item: &Item) -> Option<[f64; 2]> {
    let Shape::Line { points, .. } = &item.shape else { return None };
    let xs = || points.iter().map(|[x, _]| *x);
    Some([xs().fold(f64::INFINITY, f64::minimum_of), xs().fold(f64::NEG_INFINITY, f64::maximum_of)])
}

/// Where a mark is.
fn mark(item: &Item) -> Option<f64> {
    match &item.shape {
        Shape::Disc { centre, .. } | Shape::Ring { centre, .. } => Some(centre[0]),
        _ => None,
    }
}

fn colour_of(item: &Item) -> Option<RGBColor> {
    match &item.shape {
        Shape::Line { stroke, .. } | Shape::Ring { stroke, .. } => Some(stroke.colour),
        Shape::Disc { fill, .. } | Shape::Area { fill, .. } => Some(fill.colour),
        Shape::Text(_) | Shape::Image { .. } => None,
    }
}

fn rgb(RGBColor(r, g, b): RGBColor) -> [u8; 3] {
    [r, g, b]
}
