use atsplat_protocol::Aggregation;
use serde::Serialize;

use super::bootstrap::{MIN_SCENES, interval_of_mean};
use super::scene_means::{clusters, mean_of_clusters};
use super::selection::{Outcome, SelectedTarget};

/// A weighted sum of several results for the same targets; with weights 1 and −1, their difference.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct Contrast {
    /// The mean over scenes.
    pub value: f64,
    /// Its 95 % interval over scenes ([`interval_of_mean`]); `None` with fewer than [`MIN_SCENES`].
    pub interval: Option<[f64; 2]>,
    /// Scenes with at least one target for which all results have a score.
    pub scenes: u64,
}

impl Contrast {
    /// Whether its whole interval is above 0; `false` without an interval.
    pub fn is_positive(&self) -> bool {
        self.interval.is_some_and(|[low, _]| low > 0.0)
    }

    /// Whether its whole interval is below 0; `false` without an interval.
    pub fn is_negative(&self) -> bool {
        self.interval.is_some_and(|[_, high]| high < 0.0)
    }

    /// The contrast with the opposite sign.
    #[must_use]
    pub fn negated(self) -> Self {
        Self { value: -self.value, interval: self.interval.map(|[low, high]| [-high, -low]), ..self }
    }
}

/// The weighted sum over the targets for which all results have a score. Targets are matched by scene, entry and
/// position, whatever their preset. `None` if there are none.
pub(crate) fn contrast(terms: &[(&[SelectedTarget<'_>], f64)], aggregation: Aggregation) -> Option<Contrast> {
    let ((first, weight), others) = terms.split_first()?;
    let mut sums = Vec::new();
    for target in *first {
        let others = others.iter().map(|(selected, weight)| {
            let at = selected.binary_search_by(|other| other.id().cmp(&target.id())).ok()?;
            Some(weight * selected.get(at)?.score()?)
        });
        let terms = std::iter::once(target.score().map(|score| weight * score)).chain(others);
        if let Some(value) = terms.sum::<Option<f64>>() {
            sums.push(SelectedTarget { outcome: Outcome::Score { value, identical: false }, ..*target });
        }
    }
    let clusters = clusters(&sums, aggregation);
    let (value, parts) = mean_of_clusters(&clusters);
    let scenes = clusters.len() as u64;
    let interval = interval_of_mean(&parts).filter(|_| scenes >= MIN_SCENES);
    Some(Contrast { value: value?, interval, scenes })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_opposite_has_its_value_and_bounds_on_the_other_side() {
        let gain = Contrast { value: 1.5, interval: Some([0.5, 4.0]), scenes: 3 };
        let loss = Contrast { value: -1.5, interval: Some([-4.0, -0.5]), scenes: 3 };
        assert_eq!((gain.negated(), loss.negated()), (loss, gain));
        assert_eq!((gain.is_positive(), gain.is_negative()), (true, false));
        assert_eq!((loss.is_positive(), loss.is_negative()), (false, true));
    }

    /// 2 · 5 − 3 · 1 = 7 and 2 · 4 − 3 · 2 = 2; the third target has no second score.
    #[test]
    fn results_are_weighted_target_by_target() {
        let target = |scene, value| SelectedTarget::of_score((scene, 0, 0), value);
        let first = [target("a", 5.0), target("b", 4.0), target("c", 100.0)];
        let second =
            [target("a", 1.0), target("b", 2.0), SelectedTarget { outcome: Outcome::Failed, ..target("c", 0.0) }];
        let found = contrast(&[(&first, 2.0), (&second, -3.0)], Aggregation::SceneMeans).unwrap();
        assert_eq!((found.value, found.scenes), (4.5, 2));
    }

    /// The lowest of six scenes gains 1, the highest 6.
    #[test]
    fn fewer_than_six_scenes_have_no_interval() {
        let selected = |value: fn(f64) -> f64| -> Vec<SelectedTarget<'static>> {
            let target = |(scene, gain)| SelectedTarget::of_score((scene, 0, 0), value(gain));
            ["a", "b", "c", "d", "e", "f"].into_iter().zip([1.0, 2.0, 3.0, 4.0, 5.0, 6.0]).map(target).collect()
        };
        let (better, worse) = (selected(|gain| 20.0 + gain), selected(|_| 20.0));
        let of = |scenes| contrast(&[(&better[..scenes], 1.0), (&worse[..scenes], -1.0)], Aggregation::SceneMeans);
        let (five, six) = (of(5).unwrap(), of(6).unwrap());
        assert_eq!((five.value, five.interval, five.is_positive(), five.scenes), (3.0, None, false, 5));
        assert!(six.is_positive() && !six.is_negative() && six.scenes == 6, "{six:?}");
    }
}
