use atsplat_metrics::Direction;
use serde::{Deserialize, Serialize};

use crate::statistics::Contrast;

/// One setting of a method: its quality and cost.
#[derive(Clone, Debug, PartialEq)]
pub struct Sample {
    /// The setting's name in tables.
    pub label: String,
    /// Mean score, or why nothing was scored.
    pub quality: Result<f64, String>,
    /// The time to the first image, or why there is none.
    pub secs: Result<Seconds, String>,
    /// Mean number of Gaussians, over the trials in which every setting made some if there are any.
    pub gaussians: Option<f64>,
    /// What the quality is over, and what is missing from it.
    pub counts: Counts,
}

/// Seconds from images in memory to the first rendered image, from a timing pass ([`crate::times::Times::first_image`]).
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Seconds {
    /// Their median.
    pub median: f64,
    /// Half-width of their 95 % interval ([`crate::times::Spread::error`]).
    pub error: f64,
    /// Whether the machine was busy with other work while they were measured.
    pub busy: bool,
    /// Whether they include the whole answer of a process, with reading and writing of files.
    pub whole_answer: bool,
    /// What ran on a graphics adapter, as [`crate::times::Times::device`].
    pub device: Option<String>,
}

/// Targets of a mean score, and why others are not in it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct Counts {
    /// Scenes in the mean.
    pub scenes: u64,
    /// Targets in the mean.
    pub targets: u64,
    /// Targets without a render or a ground truth.
    pub failed: u64,
    /// Targets of trials that the method does not support.
    pub not_applicable: u64,
    /// Targets whose render or score is not finite.
    pub non_finite: u64,
    /// Targets whose score was not computed.
    pub uncomputed: u64,
    /// Targets whose render is identical to the truth.
    pub identical: u64,
}

/// The cost axis.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Axis {
    /// [`Sample::secs`].
    Seconds,
    /// [`Sample::gaussians`].
    Gaussians,
}

/// A sample with a finite quality and cost.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct Point {
    /// Same as [`Sample::label`].
    pub label: String,
    /// Same as [`Sample::quality`]; finite.
    pub quality: f64,
    /// Cost on the axis; finite and positive.
    pub cost: f64,
    /// Half-width of the cost's 95 % interval; 0 for counts.
    pub cost_error: f64,
    /// [`Seconds::median`], if there are seconds.
    pub secs: Option<f64>,
    /// [`Seconds::error`]; 0 without seconds.
    pub secs_error: f64,
    /// [`Seconds::busy`]; false without seconds.
    pub busy: bool,
    /// [`Seconds::whole_answer`]; false without seconds.
    pub whole_answer: bool,
    /// Same as [`Sample::gaussians`].
    pub gaussians: Option<f64>,
    /// Its relation to the frontier.
    pub standing: Standing,
    /// Difference in quality over the same targets from the previous point of the frontier; for the cheapest point, from the
    /// next one. `None` if there is no other point or no common target.
    pub against: Option<PointDifference>,
    /// Position among the samples.
    #[serde(skip)]
    sample: usize,
}

/// The difference in quality between two points over the same targets.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct PointDifference {
    /// Label of the other point.
    pub label: String,
    /// The point's quality minus the other's, scene by scene, with its 95 % interval.
    #[serde(flatten)]
    pub difference: Contrast,
}

/// A point's relation to the frontier.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Standing {
    /// Pareto-optimal: the cheapest point, or better than the previous point of the frontier by more than the interval of
    /// their difference.
    Frontier,
    /// Worse than a point that costs no more, by more than the interval of their difference.
    Worse,
    /// The interval of the difference from a cheaper point contains 0 or does not exist; more scenes may decide.
    NotDistinguishable,
}

/// A Pareto frontier of quality against cost.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct Frontier {
    /// The cost axis.
    pub axis: Axis,
    /// All points by increasing cost; at equal cost the best first, then by label.
    pub points: Vec<Point>,
    /// The price of more quality from each point of the frontier to the next.
    pub prices: Vec<Price>,
    /// Label of the knee: of the points between the frontier's ends, the one farthest above the straight line between the
    /// ends, with quality and the logarithm of cost each scaled to [0, 1] (the difference curve of Satopää et al., "Finding a
    /// 'Kneedle' in a Haystack", 2011, without its smoothing). `None` if no point is above the line by more than the 95 %
    /// interval of that height.
    pub knee: Option<String>,
    /// Labels of samples that cannot be compared, with the reason.
    pub left_out: Vec<(String, String)>,
}

/// Cost of a step of quality between two neighbours on a frontier, at the rate between them.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct Price {
    /// Label of the cheaper point.
    pub from: String,
    /// Label of the more expensive point.
    pub to: String,
    /// Difference in quality over the same targets; positive whatever the metric's direction.
    pub gain: f64,
    /// The gain's 95 % interval, which does not contain 0.
    pub gain_interval: [f64; 2],
    /// The step that is priced, in the metric's unit.
    pub step: f64,
    /// Seconds for the step; negative if the better point is faster. `None` if one of them is untimed, or if they differ by
    /// less than the measurement error.
    pub secs: Option<f64>,
    /// Whether the machine was busy while one of them was timed, so that the seconds are not reliable.
    pub busy: bool,
    /// Whether the seconds of one of them are those of a whole answer ([`Seconds::whole_answer`]).
    pub whole_answer: bool,
    /// Gaussians for the step, likewise.
    pub gaussians: Option<f64>,
}

/// A weighted sum of the mean scores of samples, given by position, with its interval over scenes; `None` if they have no
/// common targets.
pub type Contrasts<'a> = dyn Fn(&[(usize, f64)]) -> Option<Contrast> + 'a;

impl Point {
    /// Whether it is on the frontier.
    pub fn on_frontier(&self) -> bool {
        self.standing == Standing::Frontier
    }
}

/// The frontier of samples along an axis, for a metric of this direction. `step` is the step of quality that is priced, such
/// as 0.1 dB.
pub fn frontier(
    samples: &[Sample],
    contrasts: &Contrasts<'_>,
    direction: Direction,
    axis: Axis,
    step: f64,
) -> Frontier {
    let (mut points, mut left_out) = (Vec::new(), Vec::new());
    for (position, sample) in samples.iter().enumerate() {
        match point(position, sample, axis) {
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
    let ranking = Ranking { contrasts, direction };
    let positions = ranking.rank(&mut points);
    let on_frontier: Vec<&Point> = positions.into_iter().filter_map(|position| points.get(position)).collect();
    let (prices, knee) = (prices(&on_frontier, step), ranking.knee(&on_frontier));
    Frontier { axis, points, prices, knee, left_out }
}

fn point(position: usize, sample: &Sample, axis: Axis) -> Result<Point, String> {
    let Sample { label, quality, secs, gaussians, .. } = sample.clone();
    let quality = quality.map_err(|why| format!("nothing was scored: {why}"))?;
    if !quality.is_finite() {
        return Err("nothing was scored".to_owned());
    }
    let (name, cost, cost_error) = match axis {
        Axis::Seconds => {
            let Seconds { median, error, .. } = secs.clone()?;
            ("seconds", median, error)
        }
        Axis::Gaussians => ("Gaussians", gaussians.ok_or("no Gaussians")?, 0.0),
    };
    if !cost.is_finite() || cost <= 0.0 {
        return Err(format!("{cost} {name}"));
    }
    let timed = secs.ok();
    let Seconds { error: secs_error, busy, whole_answer, .. } = timed.clone().unwrap_or_default();
    let secs = timed.map(|secs| secs.median);
    let (standing, against) = (Standing::NotDistinguishable, None);
    Ok(Point {
        label,
        quality,
        cost,
        cost_error,
        secs,
        secs_error,
        busy,
        whole_answer,
        gaussians,
        standing,
        against,
        sample: position,
    })
}

/// Compares points by the intervals of their differences.
struct Ranking<'a> {
    contrasts: &'a Contrasts<'a>,
    direction: Direction,
}

impl Ranking<'_> {
    /// Sets the standing of every point, cheapest first; returns the positions of those on the frontier.
    fn rank(&self, points: &mut [Point]) -> Vec<usize> {
        let mut frontier: Vec<usize> = Vec::new();
        for position in 0..points.len() {
            let difference = frontier.last().and_then(|last| self.difference(&points[position], &points[*last]));
            let standing = match (frontier.is_empty(), difference) {
                (true, _) => Standing::Frontier,
                (false, Some(difference)) if self.is_better(&difference) => Standing::Frontier,
                (false, Some(difference)) if self.is_better(&difference.negated()) => Standing::Worse,
                (false, _) => Standing::NotDistinguishable,
            };
            if standing == Standing::Frontier {
                self.drop_dominated(points, &mut frontier, position);
            }
            let against = frontier.last().and_then(|last| self.compared(&points[position], &points[*last]));
            points[position].against = against;
            points[position].standing = standing;
            frontier.extend((standing == Standing::Frontier).then_some(position));
        }
        self.compare_with_final(points, &frontier);
        // The cheapest point has no predecessor and is compared with its successor.
        if let Some(cheapest) = frontier.first().copied() {
            let next = frontier.get(1).copied().or_else(|| (0..points.len()).find(|position| *position != cheapest));
            points[cheapest].against = next.and_then(|next| self.compared(&points[cheapest], &points[next]));
        }
        frontier
    }

    /// Compares points off the frontier with its final points: they were compared with the last one before them, which may have been
    /// dropped since, or be followed by one of the same cost. Of those that cost no more, or the same, the last with common targets
    /// counts, unless the point is better: that one was not the last when they were compared.
    fn compare_with_final(&self, points: &mut [Point], frontier: &[usize]) {
        for position in (0..points.len()).filter(|position| !frontier.contains(position)) {
            let point = &points[position];
            let known = point.against.as_ref().map(|against| against.label.as_str());
            let is_known = |on: &usize| known == Some(points[*on].label.as_str());
            if point.standing == Standing::Worse && frontier.iter().any(is_known) {
                continue;
            }
            let costs_no_more = |on: &usize| *on < position || same_cost(&points[*on], point);
            let others = frontier.iter().rev().copied().filter(costs_no_more).take_while(|on| !is_known(on));
            let mut differences = others.filter_map(|on| Some((on, self.difference(point, &points[on])?)));
            let Some((last, difference)) = differences.find(|(_, difference)| !self.is_better(difference)) else {
                continue;
            };
            if self.is_better(&difference.negated()) {
                points[position].standing = Standing::Worse;
            }
            let label = points[last].label.clone();
            points[position].against = Some(PointDifference { label, difference });
        }
    }

    /// Costs that differ by less than their measurement error are equal: a worse point of that cost is dropped in favour of the
    /// better one, provided that the better one is also better than the point before.
    fn drop_dominated(&self, points: &mut [Point], frontier: &mut Vec<usize>, better: usize) {
        while let Some((&last, before)) = frontier.split_last() {
            let stays = |before: &usize| {
                let difference = self.difference(&points[better], &points[*before]);
                difference.is_some_and(|difference| self.is_better(&difference))
            };
            if !same_cost(&points[last], &points[better]) || !before.last().is_none_or(stays) {
                break;
            }
            points[last].standing = Standing::Worse;
            points[last].against = self.compared(&points[last], &points[better]);
            frontier.pop();
        }
    }

    fn difference(&self, point: &Point, other: &Point) -> Option<Contrast> {
        (self.contrasts)(&[(point.sample, 1.0), (other.sample, -1.0)])
    }

    fn compared(&self, point: &Point, other: &Point) -> Option<PointDifference> {
        Some(PointDifference { label: other.label.clone(), difference: self.difference(point, other)? })
    }

    fn is_better(&self, difference: &Contrast) -> bool {
        match self.direction {
            Direction::Higher => difference.is_positive(),
            Direction::Lower => difference.is_negative(),
        }
    }

    /// `frontier` is ordered by cost.
    fn knee(&self, frontier: &[&Point]) -> Option<String> {
        let [first, between @ .., last] = frontier else { return None };
        let mut highest: Option<(f64, &Point)> = None;
        for point in between {
            let along = (point.cost / first.cost).ln() / (last.cost / first.cost).ln();
            let terms = [(point.sample, 1.0), (first.sample, along - 1.0), (last.sample, -along)];
            let Some(height) = (self.contrasts)(&terms).filter(|height| self.is_better(height)) else { continue };
            // Of equally high points the first one, which is the cheapest.
            if highest.is_none_or(|(known, _)| height.value.abs() > known) {
                highest = Some((height.value.abs(), point));
            }
        }
        highest.map(|(_, point)| point.label.clone())
    }
}

/// Whether the 95 % interval of the difference of two costs contains 0.
fn same_cost(a: &Point, b: &Point) -> bool {
    (a.cost - b.cost).abs() <= a.cost_error.hypot(b.cost_error)
}

/// Prices from each point of a frontier to the next.
fn prices(frontier: &[&Point], step: f64) -> Vec<Price> {
    frontier.windows(2).filter_map(|pair| price(pair[0], pair[1], step)).collect()
}

fn price(from: &Point, to: &Point, step: f64) -> Option<Price> {
    let difference = to.against.as_ref().filter(|against| against.label == from.label)?.difference;
    let [low, high] = difference.interval?.map(f64::abs);
    let gain = difference.value.abs();
    let rate = |a: Option<f64>, b: Option<f64>| Some((b? - a?) / gain * step).filter(|price| price.is_finite());
    let apart = from.secs.zip(to.secs).is_some_and(|(a, b)| (a - b).abs() > from.secs_error.hypot(to.secs_error));
    Some(Price {
        from: from.label.clone(),
        to: to.label.clone(),
        gain,
        gain_interval: if low <= high { [low, high] } else { [high, low] },
        step,
        secs: rate(from.secs, to.secs).filter(|_| apart),
        busy: from.busy || to.busy,
        whole_answer: from.whole_answer || to.whole_answer,
        gaussians: rate(from.gaussians, to.gaussians),
    })
}
