use serde::Serialize;

use super::Point;

/// What a step of quality costs between two neighbours on a frontier, at the rate between them.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct Price {
    /// Label of the cheaper point.
    pub from: String,
    /// Label of the dearer one.
    pub to: String,
    /// How much quality lies between them; positive, whatever the metric's direction.
    pub gain: f64,
    /// The step that is priced, in the metric's unit.
    pub step: f64,
    /// Seconds for the step; negative where the better point is faster. `None` where one of both has none.
    pub secs: Option<f64>,
    /// Gaussians for the step, likewise.
    pub gaussians: Option<f64>,
}

/// Prices from each point to the next.
pub(super) fn prices(ascent: &[&Point], step: f64) -> Vec<Price> {
    let price = |pair: &[&Point]| {
        let [from, to] = pair else { return None };
        let gain = (to.quality - from.quality).abs();
        let rate = |a: Option<f64>, b: Option<f64>| Some((b? - a?) / gain * step).filter(|price| price.is_finite());
        Some(Price {
            from: from.label.clone(),
            to: to.label.clone(),
            gain,
            step,
            secs: rate(from.secs, to.secs),
            gaussians: rate(from.gaussians, to.gaussians),
        })
    };
    ascent.windows(2).filter_map(price).collect()
}
