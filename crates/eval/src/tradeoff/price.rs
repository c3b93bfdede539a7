use serde::Serialize;

use super::Point;

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
    /// Gaussians for the step, likewise.
    pub gaussians: Option<f64>,
}

/// Prices from each point of a frontier to the next.
pub(super) fn prices(frontier: &[&Point], step: f64) -> Vec<Price> {
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
        gaussians: rate(from.gaussians, to.gaussians),
    })
}
