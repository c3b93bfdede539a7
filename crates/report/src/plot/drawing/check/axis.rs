use std::collections::BTreeMap;

use atsplat_numeric::Extremes as _;

use super::super::shape::{Extent, Role};
use super::{FaultKind, PlotFault, Printed, fault};

/// How far a tick may be from where its rounded label says, in pixels.
const OFF: f64 = 3.0;

/// Axes without a title or with a single tick, and ticks whose labels are not plain numbers at the places of these numbers.
pub(super) fn faults(texts: &[Printed<'_>]) -> Vec<PlotFault> {
    let mut axes: BTreeMap<u32, (Vec<&Printed<'_>>, Option<&str>)> = BTreeMap::new();
    for text in texts {
        match text.role {
            Role::Tick(axis) => axes.entry(*axis).or_default().0.push(text),
            Role::Axis(axis) => axes.entry(*axis).or_default().1 = Some(&text.line.text),
            _ => {}
        }
    }
    axes.values().filter_map(|(ticks, title)| of_axis(ticks, *title)).map(|what| fault(FaultKind::Axis, what)).collect()
}

fn of_axis(ticks: &[&Printed<'_>], title: Option<&str>) -> Option<String> {
    let Some(title) = title else { return Some("an axis without a title".to_owned()) };
    if let [only] = ticks {
        return Some(format!("the axis “{title}” has a single tick, “{}”", only.line.text));
    }
    let mut values = Vec::new();
    for tick in ticks {
        let Some(value) = number(&tick.line.text) else {
            return Some(format!("“{}” on the axis “{title}” is not a plain number", tick.line.text));
        };
        values.push((value, middle(tick.extent)));
    }
    let across = |at: usize| {
        let distance = |place: [f64; 2]| values.first().map_or(0.0, |(_, first)| (place[at] - first[at]).abs());
        values.iter().map(|(_, place)| distance(*place)).fold(0.0, f64::maximum_of)
    };
    // Up and to the right is more.
    let (along, sign) = if across(0) >= across(1) { (0, 1.0) } else { (1, -1.0) };
    let mut points: Vec<(f64, f64)> = values.iter().map(|(value, place)| (*value, sign * place[along])).collect();
    points.sort_by(|a, b| a.1.total_cmp(&b.1));
    if points.windows(2).any(|pair| pair[0].0 >= pair[1].0) {
        return Some(format!("the ticks of “{title}” do not increase: {:?}", labels(ticks)));
    }
    let straight = is_straight(&points);
    let logarithmic = points.iter().all(|(value, _)| *value > 0.0)
        && is_straight(&points.iter().map(|(value, place)| (value.ln(), *place)).collect::<Vec<_>>());
    (!straight && !logarithmic).then(|| format!("the ticks of “{title}” are not where they say: {:?}", labels(ticks)))
}

fn labels<'a>(ticks: &'a [&Printed<'_>]) -> Vec<&'a str> {
    ticks.iter().map(|tick| tick.line.text.as_str()).collect()
}

fn middle(extent: Extent) -> [f64; 2] {
    [f64::midpoint(extent.left, extent.right), f64::midpoint(extent.top, extent.bottom)]
}

/// Whether the places are a linear function of the values, between the first and the last.
fn is_straight(points: &[(f64, f64)]) -> bool {
    let (Some((low, from)), Some((high, to))) = (points.first(), points.last()) else { return true };
    points.iter().all(|(value, place)| {
        let expected = if high > low { from + (value - low) / (high - low) * (to - from) } else { *from };
        (expected - place).abs() < OFF
    })
}

/// A number as axes write it: an optional sign, digits, and K or M for thousands and millions.
fn number(text: &str) -> Option<f64> {
    let text = text.replace('−', "-");
    let (digits, scale) = match text.strip_suffix('K') {
        Some(digits) => (digits, 1e3),
        None => text.strip_suffix('M').map_or((text.as_str(), 1.0), |digits| (digits, 1e6)),
    };
    let digits = digits.strip_prefix('+').unwrap_or(digits);
    digits.parse::<f64>().ok().filter(|value| value.is_finite()).map(|value| value * scale)
}
