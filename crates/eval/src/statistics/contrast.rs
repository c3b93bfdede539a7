use atsplat_protocol::Aggregation;
use serde::Serialize;

use super::bootstrap::interval_of_mean;
use super::scene_means::clusters;
use super::selection::{Outcome, SelectedTarget};

/// A weighted sum of several answers to the same targets; of weights 1 and −1, their difference.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct Contrast {
    /// The mean over scenes.
    pub value: f64,
    /// Its 95 % interval over scenes ([`interval_of_mean`]); `None` with one scene.
    pub interval: Option<[f64; 2]>,
    /// Scenes with at least one target that all have a score for.
    pub scenes: u64,
}

impl Contrast {
    /// Whether it lies above 0 with all of its interval: without an interval nobody can tell.
    pub fn is_positive(&self) -> bool {
        self.interval.is_some_and(|[low, _]| low > 0.0)
    }

    /// Whether it lies below 0 with all of its interval.
    pub fn is_negative(&self) -> bool {
        self.interval.is_some_and(|[_, high]| high < 0.0)
    }

    /// The same with the opposite sign.
    #[must_use]
    pub fn negated(self) -> Self {
        Self { value: -self.value, interval: self.interval.map(|[low, high]| [-high, -low]), ..self }
    }
}

/// The sum of answers times their weights, over the targets that all have a score for; targets are matched by scene, entry and
/// position, whatever preset they belong to. `None` where there are none.
pub(crate) fn contrast(terms: &[(&[SelectedTarget<'_>], f64)], aggregation: Aggregation) -> Option<Contrast> {
    let ((first, weight), others) = terms.split_first()?;
    let mut sums = Vec::new();
    for target in *first {
        let others = others.iter().map(|(selected, weight)| {
            let at = selected.binary_search_by(|other| other.place().cmp(&target.place())).ok()?;
            Some(weight * score(selected.get(at)?)?)
        });
        let terms = std::iter::once(score(target).map(|score| weight * score)).chain(others);
        if let Some(value) = terms.sum::<Option<f64>>() {
            sums.push(SelectedTarget { outcome: Outcome::Score { value, identical: false }, ..*target });
        }
    }
    let clusters = clusters(&sums, aggregation);
    let parts: Vec<[f64; 2]> = clusters.iter().map(|cluster| [cluster.sum, cluster.weight]).collect();
    let [sum, weight] = parts.iter().fold([0.0, 0.0], |[sum, weight], [s, w]| [sum + s, weight + w]);
    let value = Some(sum / weight).filter(|mean| mean.is_finite())?;
    Some(Contrast { value, interval: interval_of_mean(&parts), scenes: clusters.len() as u64 })
}

fn score(selected: &SelectedTarget<'_>) -> Option<f64> {
    match selected.outcome {
        Outcome::Score { value, .. } => Some(value),
        _ => None,
    }
}
