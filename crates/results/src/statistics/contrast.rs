use std::collections::{BTreeMap, BTreeSet};

use atsplat_protocol::Aggregation;
use serde::Serialize;

use super::bootstrap::{MIN_SCENES, interval_of_mean};
use super::scene_means::{clusters, mean_of_clusters};
use super::selection::{ImageKey, Outcome, SelectedTarget};

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
    /// Targets for which some results have a score, but not all; they are excluded.
    pub unpaired: u64,
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

/// The weighted sum over the targets for which all results have a score ([`weighted_sums`]). `None` if there are none.
pub(crate) fn contrast(terms: &[(&[SelectedTarget<'_>], f64)], aggregation: Aggregation) -> Option<Contrast> {
    let (sums, unpaired) = weighted_sums(terms);
    let clusters = clusters(&sums, aggregation);
    let (value, parts) = mean_of_clusters(&clusters);
    let scenes = clusters.len() as u64;
    let interval = interval_of_mean(&parts).filter(|_| scenes >= MIN_SCENES);
    Some(Contrast { value: value?, interval, scenes, unpaired })
}

/// The weighted sums of the targets for which all results have a score, in the order of the first, and the number of targets for
/// which only some have one. Targets are matched by scene, entry and frame, whatever their preset, because the same position can be
/// another image there.
pub(super) fn weighted_sums<'a>(terms: &[(&[SelectedTarget<'a>], f64)]) -> (Vec<SelectedTarget<'a>>, u64) {
    let Some(((first, weight), others)) = terms.split_first() else { return (Vec::new(), 0) };
    let by_image = |selected| SelectedTarget::scored(selected).map(|(image, _, score)| (image, score)).collect();
    let others: Vec<(BTreeMap<ImageKey<'_>, f64>, f64)> =
        others.iter().map(|(selected, weight)| (by_image(selected), *weight)).collect();
    let mut unpaired: BTreeSet<ImageKey<'_>> = others.iter().flat_map(|(scores, _)| scores.keys().copied()).collect();
    let mut sums = Vec::new();
    for (image, target, score) in SelectedTarget::scored(first) {
        let others = others.iter().map(|(scores, weight)| Some(weight * scores.get(&image)?));
        if let Some(value) = std::iter::once(Some(weight * score)).chain(others).sum::<Option<f64>>() {
            unpaired.remove(&image);
            sums.push(SelectedTarget { outcome: Outcome::Score { value, identical: false }, ..*target });
        } else {
            unpaired.insert(image);
        }
    }
    (sums, unpaired.len() as u64)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_opposite_has_its_value_and_bounds_on_the_other_side() {
        let gain = Contrast { value: 1.5, interval: Some([0.5, 4.0]), scenes: 3, unpaired: 2 };
        let loss = Contrast { value: -1.5, interval: Some([-4.0, -0.5]), scenes: 3, unpaired: 2 };
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
        assert_eq!((found.value, found.scenes, found.unpaired), (4.5, 2, 1));
    }

    /// As under two protocols of a scene: frames 10, 20 and 30, and frames 20, 40, 60 and 30.
    #[test]
    fn targets_are_paired_by_frame_not_by_position() {
        let targets = |scores: &[(u64, f64)]| -> Vec<SelectedTarget<'static>> {
            let target =
                |((frame, value), at)| SelectedTarget { frame, ..SelectedTarget::of_score(("a", 0, at), value) };
            scores.iter().copied().zip(0..).map(target).collect()
        };
        let difference = |first: &[(u64, f64)], second: &[(u64, f64)]| {
            let found = contrast(&[(&targets(first), 1.0), (&targets(second), -1.0)], Aggregation::SceneMeans)?;
            Some((found.value, found.unpaired))
        };
        let first = [(10, 100.0), (20, 5.0), (30, 8.0)];
        let second = [(20, 3.0), (40, 50.0), (60, 70.0), (30, 2.0)];
        assert_eq!(difference(&first, &second), Some((4.0, 3)), "2 at frame 20, 6 at frame 30");
        assert_eq!(difference(&second, &first), Some((-4.0, 3)));
        assert_eq!(difference(&first, &[(11, 3.0), (21, 3.0)]), None);
        // A target that the index repeats counts as often as in the protocol's mean.
        assert_eq!(difference(&[(7, 9.0), (7, 5.0)], &[(7, 4.0), (7, 3.0)]), Some((3.5, 0)));
        assert_eq!(difference(&[(7, 9.0), (7, 5.0)], &[(7, 4.0)]), Some((5.0, 1)));
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
