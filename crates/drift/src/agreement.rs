use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use atsplat_numeric::Tolerance;
use atsplat_results::TrialKey;

use super::data::images_of_targets;
use super::history::{Name, means_of};
use super::{AcceptedNumber, Baseline, DriftError};

/// A mean may have been summed in another order by an older version.
const ROUNDED: Tolerance = Tolerance { absolute: 1e-9, relative: 1e-9 };

/// An error if the parts of a baseline disagree. Rows that an edit or a merge of the file has lost would not be compared any more,
/// and nothing would say so.
pub(super) fn require_agreement(baseline: &Baseline, path: &Path) -> Result<(), DriftError> {
    let trials: BTreeSet<_> = baseline.trials.iter().map(|trial| &trial.key).collect();
    if let Some(row) = baseline.targets.iter().find(|row| !trials.contains(&row.key)) {
        let found = format!("no trial {}, of which there is target {}", row.key, row.target);
        return Err(DriftError::malformed(path, "trials", "the trial of each target", found));
    }
    let images: BTreeSet<_> = baseline.images.iter().collect();
    if let Some(image) = images_of_targets(&baseline.targets).iter().find(|image| !images.contains(image)) {
        let found = format!("none of {}, scene {}, frame {} with its hash", image.preset, image.scene, image.frame);
        return Err(DriftError::malformed(path, "images", "the image of each target", found));
    }
    require_targets(baseline, path)?;
    require_means(baseline, path)
}

/// An error unless each trial has targets 0, 1 and so on, as many as the same trial of other methods. Those without a score are in no
/// mean.
fn require_targets(baseline: &Baseline, path: &Path) -> Result<(), DriftError> {
    let mut targets: BTreeMap<&TrialKey, BTreeSet<u32>> = BTreeMap::new();
    for trial in &baseline.trials {
        targets.entry(&trial.key).or_default();
    }
    for row in &baseline.targets {
        targets.entry(&row.key).or_default().insert(row.target);
    }
    let mut counts: BTreeMap<(&str, &str, u32), (&TrialKey, usize)> = BTreeMap::new();
    for (key, targets) in targets {
        if let Some((expected, found)) = (0u32..).zip(&targets).find(|(expected, found)| expected != *found) {
            let expected = format!("target {expected} of {key}");
            return Err(DriftError::malformed(path, "targets", expected, format!("target {found} instead")));
        }
        let found = targets.len();
        let (first, count) = *counts.entry((&key.preset, &key.scene, key.entry)).or_insert((key, found));
        if count != found {
            let expected = format!("as many targets of {key} as of {}, {count}", first.method);
            return Err(DriftError::malformed(path, "targets", expected, found));
        }
    }
    Ok(())
}

/// An error unless the numbers of the last acceptance are those of the targets.
fn require_means(baseline: &Baseline, path: &Path) -> Result<(), DriftError> {
    let last = baseline.history.len().saturating_sub(1);
    let of_last = baseline.numbers.iter().filter(|number| number.acceptance == last);
    let name = |number: &AcceptedNumber| (number.preset.clone(), number.method.clone(), number.metric.clone());
    let recorded: BTreeMap<Name, f64> = of_last.map(|number| (name(number), number.mean)).collect();
    let means = means_of(&baseline.targets);
    let names: BTreeSet<_> = recorded.keys().chain(means.keys()).collect();
    for name in names {
        let (recorded, mean) = (recorded.get(name).copied(), means.get(name).copied());
        if recorded.zip(mean).is_some_and(|(recorded, mean)| ROUNDED.accepts(recorded, mean)) {
            continue;
        }
        let (preset, method, metric) = name;
        let shown = |mean: Option<f64>| mean.map_or_else(|| "none".to_owned(), |mean| mean.to_string());
        let expected =
            format!("{} as {metric} of {method} under {preset}, which is the mean of its targets", shown(mean));
        return Err(DriftError::malformed(path, "numbers", expected, shown(recorded)));
    }
    Ok(())
}
