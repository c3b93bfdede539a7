use atsplat_metrics::Direction;
use serde::{Deserialize, Serialize};

use super::price::{Price, prices};
use crate::statistics::Contrast;

/// One way to run a method: what it scores and what it takes.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct Sample {
    /// Which way, as a table says it.
    pub label: String,
    /// Mean score; `None` where nothing was scored.
    pub quality: Option<f64>,
    /// Median seconds from pictures in memory to the first picture rendered, of a timing pass.
    pub secs: Option<f64>,
    /// Half the width of their 95 % interval ([`crate::timing::Spread::error`]).
    pub secs_error: f64,
    /// Whether the machine was busy with something else while they were measured.
    pub busy: bool,
    /// Why there are no seconds.
    pub untimed: Option<String>,
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
    /// Half the width of the cost's 95 % interval; 0 for counts.
    pub cost_error: f64,
    /// As [`Sample::secs`].
    pub secs: Option<f64>,
    /// As [`Sample::secs_error`].
    pub secs_error: f64,
    /// As [`Sample::busy`].
    pub busy: bool,
    /// As [`Sample::gaussians`].
    pub gaussians: Option<f64>,
    /// What its interval allows to say.
    pub standing: Standing,
    /// How its quality differs from another's over the same targets: from that of the frontier's last point before it; of the
    /// cheapest, from that of the next. `None` where it is alone, or has no target in common with it.
    pub against: Option<Against>,
    /// Position among the samples.
    #[serde(skip)]
    pub(super) sample: usize,
}

/// A paired difference.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct Against {
    /// Label of the other point.
    pub label: String,
    /// Own quality minus the other's, scene by scene, with its 95 % interval.
    #[serde(flatten)]
    pub difference: Contrast,
}

/// What can be said of a point.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Standing {
    /// Nothing cheaper is as good: it is the cheapest, or better than the frontier's last point before it by more than the
    /// interval of their difference.
    Frontier,
    /// Worse, by more than the interval, than a point that costs no more.
    Worse,
    /// The interval of the difference from a cheaper point holds 0, or there is none: more scenes may tell.
    NotDistinguishable,
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
    /// where no point lies above the line by more than the 95 % interval of that height.
    pub knee: Option<String>,
    /// Labels of samples that cannot be compared, and why.
    pub left_out: Vec<(String, String)>,
}

/// The mean of samples' scores, given by position, times weights, with its interval over scenes; `None` where they have no
/// targets in common.
pub type Contrasts<'a> = dyn Fn(&[(usize, f64)]) -> Option<Contrast> + 'a;

impl Point {
    /// Whether nothing cheaper is known to be as good.
    pub fn on_frontier(&self) -> bool {
        self.standing == Standing::Frontier
    }
}

/// The frontier of samples along an axis, for a metric of this direction. `step` is the amount of quality that is priced, as
/// 0.1 for decibels.
pub fn frontier(
    samples: &[Sample],
    contrasts: &Contrasts<'_>,
    direction: Direction,
    axis: Axis,
    step: f64,
) -> Frontier {
    let (mut points, mut left_out) = (Vec::new(), Vec::new());
    for (at, sample) in samples.iter().enumerate() {
        match point(at, sample, axis) {
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
    let judge = Judge { contrasts, direction };
    let ascent = judge.stand(&mut points);
    let ascent: Vec<&Point> = ascent.into_iter().filter_map(|at| points.get(at)).collect();
    let (prices, knee) = (prices(&ascent, step), judge.knee(&ascent));
    Frontier { axis, points, prices, knee, left_out }
}

fn point(at: usize, sample: &Sample, axis: Axis) -> Result<Point, String> {
    let Sample { label, quality, secs, secs_error, busy, untimed, gaussians } = sample.clone();
    let (name, cost, cost_error) = match axis {
        Axis::Seconds => ("seconds", secs, secs_error),
        Axis::Gaussians => ("Gaussians", gaussians, 0.0),
    };
    let quality = quality.filter(|value| value.is_finite()).ok_or("nothing was scored")?;
    let cost = cost.ok_or_else(|| untimed.filter(|_| axis == Axis::Seconds).unwrap_or_else(|| format!("no {name}")))?;
    if !cost.is_finite() || cost <= 0.0 {
        return Err(format!("{cost} {name}"));
    }
    let (standing, against) = (Standing::NotDistinguishable, None);
    Ok(Point { label, quality, cost, cost_error, secs, secs_error, busy, gaussians, standing, against, sample: at })
}

/// Says what intervals allow to say.
struct Judge<'a> {
    contrasts: &'a Contrasts<'a>,
    direction: Direction,
}

impl Judge<'_> {
    /// Gives every point, the cheapest first, its standing; positions of those on the frontier.
    fn stand(&self, points: &mut [Point]) -> Vec<usize> {
        let mut ascent: Vec<usize> = Vec::new();
        for at in 0..points.len() {
            let difference = ascent.last().and_then(|last| self.difference(&points[at], &points[*last]));
            let standing = match (ascent.is_empty(), difference) {
                (true, _) => Standing::Frontier,
                (false, Some(difference)) if self.is_better(&difference) => Standing::Frontier,
                (false, Some(difference)) if self.is_better(&difference.negated()) => Standing::Worse,
                (false, _) => Standing::NotDistinguishable,
            };
            if standing == Standing::Frontier {
                self.give_way(points, &mut ascent, at);
            }
            let against = ascent.last().and_then(|last| self.compared(&points[at], &points[*last]));
            points[at].against = against;
            points[at].standing = standing;
            ascent.extend((standing == Standing::Frontier).then_some(at));
        }
        // The cheapest has nothing before it: it is compared with what follows.
        if let Some(cheapest) = ascent.first().copied() {
            let next = ascent.get(1).copied().or_else(|| (0..points.len()).find(|at| *at != cheapest));
            points[cheapest].against = next.and_then(|next| self.compared(&points[cheapest], &points[next]));
        }
        ascent
    }

    /// Costs that differ by less than repetitions do are the same: what is worse there leaves the frontier to a better point,
    /// if that is still better than what comes before.
    fn give_way(&self, points: &mut [Point], ascent: &mut Vec<usize>, better: usize) {
        while let Some((&last, before)) = ascent.split_last() {
            let stays = |before: &usize| {
                let difference = self.difference(&points[better], &points[*before]);
                difference.is_some_and(|difference| self.is_better(&difference))
            };
            if !same_cost(&points[last], &points[better]) || !before.last().is_none_or(stays) {
                break;
            }
            points[last].standing = Standing::Worse;
            points[last].against = self.compared(&points[last], &points[better]);
            ascent.pop();
        }
    }

    fn difference(&self, own: &Point, other: &Point) -> Option<Contrast> {
        (self.contrasts)(&[(own.sample, 1.0), (other.sample, -1.0)])
    }

    fn compared(&self, own: &Point, other: &Point) -> Option<Against> {
        Some(Against { label: other.label.clone(), difference: self.difference(own, other)? })
    }

    fn is_better(&self, difference: &Contrast) -> bool {
        match self.direction {
            Direction::Higher => difference.is_positive(),
            Direction::Lower => difference.is_negative(),
        }
    }

    /// `ascent` is the frontier from its cheapest point.
    fn knee(&self, ascent: &[&Point]) -> Option<String> {
        let [first, between @ .., last] = ascent else { return None };
        let mut highest: Option<(f64, &Point)> = None;
        for point in between {
            let along = (point.cost / first.cost).ln() / (last.cost / first.cost).ln();
            let terms = [(point.sample, 1.0), (first.sample, along - 1.0), (last.sample, -along)];
            let Some(height) = (self.contrasts)(&terms).filter(|height| self.is_better(height)) else { continue };
            // Of equally high points the first, which is the cheapest.
            if highest.is_none_or(|(known, _)| height.value.abs() > known) {
                highest = Some((height.value.abs(), point));
            }
        }
        highest.map(|(_, point)| point.label.clone())
    }
}

/// Whether two costs differ by no more than the 95 % interval of their difference.
pub(super) fn same_cost(a: &Point, b: &Point) -> bool {
    (a.cost - b.cost).abs() <= a.cost_error.hypot(b.cost_error)
}
