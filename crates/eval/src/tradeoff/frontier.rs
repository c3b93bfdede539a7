use std::cmp::Ordering;

use atsplat_metrics::Direction;
use serde::{Deserialize, Serialize};

use super::price::{Price, prices};

/// One way to run a method: what it scores and what it takes.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct Sample {
    /// Which way, as a table says it.
    pub label: String,
    /// Mean score; `None` where nothing was scored.
    pub quality: Option<f64>,
    /// Seconds from pictures in memory to the first picture rendered.
    pub secs: Option<f64>,
    /// Mean number of Gaussians.
    pub gaussians: Option<f64>,
}

/// What accuracy is paid in.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Axis {
    /// [`Sample::secs`].
    Seconds,
    /// [`Sample::gaussians`].
    Gaussians,
}

/// A sample that can be compared.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct Point {
    /// As [`Sample::label`].
    pub label: String,
    /// As [`Sample::quality`]; finite.
    pub quality: f64,
    /// What the axis says; finite and positive.
    pub cost: f64,
    /// As [`Sample::secs`].
    pub secs: Option<f64>,
    /// As [`Sample::gaussians`].
    pub gaussians: Option<f64>,
    /// Whether no other point is at least as good for at most as much, and better in one of both.
    pub on_frontier: bool,
}

/// What quality costs at the least.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct Frontier {
    /// What is paid.
    pub axis: Axis,
    /// All points, the cheapest first; among equally dear ones the best first, then by label.
    pub points: Vec<Point>,
    /// The price of more quality from each point of the frontier to the next.
    pub prices: Vec<Price>,
    /// Label of the point after which quality becomes dear: of the points on the frontier between its ends, the one
    /// farthest above the straight line between the ends, where quality and the logarithm of cost each run from 0 to 1
    /// (the difference curve of Satopää et al., "Finding a 'Kneedle' in a Haystack", 2011, without its smoothing). `None`
    /// where no point lies above the line.
    pub knee: Option<String>,
    /// Labels of samples that cannot be compared, and why.
    pub left_out: Vec<(String, String)>,
}

/// The frontier of samples along an axis, for a metric of this direction. `step` is the amount of quality that is priced, as
/// 0.1 for decibels.
pub fn frontier(samples: &[Sample], direction: Direction, axis: Axis, step: f64) -> Frontier {
    let (mut points, mut left_out) = (Vec::new(), Vec::new());
    for sample in samples {
        match point(sample, axis) {
            Ok(point) => points.push(point),
            Err(reason) => left_out.push((sample.label.clone(), reason)),
        }
    }
    let better = |a: f64, b: f64| match direction {
        Direction::Higher => b.total_cmp(&a),
        Direction::Lower => a.total_cmp(&b),
    };
    points.sort_by(|a, b| {
        a.cost.total_cmp(&b.cost).then(better(a.quality, b.quality)).then_with(|| a.label.cmp(&b.label))
    });
    // From the cheapest on, a point is on the frontier if it beats all before it, or is the twin of the last that did.
    let mut last: Option<(f64, f64)> = None;
    for point in &mut points {
        let place = (point.cost, point.quality);
        point.on_frontier = last.is_none_or(|last| better(place.1, last.1) == Ordering::Less || place == last);
        if point.on_frontier {
            last = Some(place);
        }
    }
    let mut ascent: Vec<&Point> = points.iter().filter(|point| point.on_frontier).collect();
    ascent.dedup_by(|b, a| (a.cost, a.quality) == (b.cost, b.quality));
    Frontier { axis, prices: prices(&ascent, step), knee: knee(&ascent), points, left_out }
}

fn point(sample: &Sample, axis: Axis) -> Result<Point, String> {
    let Sample { label, quality, secs, gaussians } = sample.clone();
    let (name, cost) = match axis {
        Axis::Seconds => ("seconds", secs),
        Axis::Gaussians => ("Gaussians", gaussians),
    };
    let quality = quality.filter(|value| value.is_finite()).ok_or("nothing was scored")?;
    let cost = cost.ok_or_else(|| format!("no {name}"))?;
    if !cost.is_finite() || cost <= 0.0 {
        return Err(format!("{cost} {name}"));
    }
    Ok(Point { label, quality, cost, secs, gaussians, on_frontier: false })
}

/// `ascent` is the frontier from its cheapest point, without twins.
fn knee(ascent: &[&Point]) -> Option<String> {
    let [first, .., last] = ascent else { return None };
    let height = |point: &Point| {
        let along = (point.cost / first.cost).ln() / (last.cost / first.cost).ln();
        (point.quality - first.quality) / (last.quality - first.quality) - along
    };
    let heights = ascent.iter().map(|point| (height(point), point)).filter(|(height, _)| *height > 0.0);
    // Of equally high points the first, which is the cheapest.
    let highest = heights.fold(None, |best: Option<(f64, &&Point)>, (height, point)| match best {
        Some((highest, _)) if highest >= height => best,
        _ => Some((height, point)),
    });
    highest.map(|(_, point)| point.label.clone())
}
