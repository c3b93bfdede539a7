use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

use atsplat_files::entries_if_exists;
use atsplat_numeric::{SplitMix64, mean, median};
use atsplat_results::statistics::is_psnr;
use atsplat_results::store::images::{self, CONTEXT, TRUTH};
use atsplat_results::{Results, TargetRow, TrialKey};

use super::Dataset;
use crate::EvalError;

/// Which images a store keeps in addition to its rows.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum KeepImages {
    /// None.
    #[default]
    Nothing,
    /// Those of each method's six trials with the lowest and two with the highest mean PSNR, and of the two nearest to the median
    /// among eight random ones; also the other methods' images of these trials, where they were rendered.
    Worst,
    /// All.
    All,
}

/// Decides which images are stored, and where.
#[derive(Clone, Copy, Debug)]
pub(super) struct ImageSink<'a> {
    pub(super) keep: KeepImages,
    pub(super) store: &'a Path,
    pub(super) chosen: &'a ChosenSoFar,
}

impl<'a> ImageSink<'a> {
    /// The store, if it keeps all images.
    pub(super) fn all(self) -> Option<&'a Path> {
        (self.keep == KeepImages::All).then_some(self.store)
    }

    /// The store, if it keeps the images of chosen trials and a trial with these rows is among them so far.
    pub(super) fn chosen(self, key: &TrialKey, rows: &[TargetRow], psnr: &str) -> Option<&'a Path> {
        (self.keep == KeepImages::Worst && self.chosen.admits(key, rows, psnr)).then_some(self.store)
    }
}

// Numbers of trials whose images are kept with `KeepImages::Worst`: of the lowest and of the highest mean PSNR, and of those
// nearest to the median among a random sample.
const WORST: usize = 6;
const BEST: usize = 2;
const TYPICAL: usize = 2;
const SAMPLE: usize = 8;

/// The worst, the best and a random sample of the trials of each method under each preset so far.
///
/// A trial that is among them at the end was among them when it was evaluated, whatever the order, so its images were stored; the
/// others' images are removed by [`prune`].
#[derive(Debug, Default)]
#[expect(clippy::type_complexity, reason = "one map")]
pub(super) struct ChosenSoFar(Mutex<BTreeMap<(String, String), [Vec<f64>; 3]>>);

impl ChosenSoFar {
    /// Whether a trial is among them so far; if so, it is recorded.
    pub(super) fn admits(&self, key: &TrialKey, rows: &[TargetRow], psnr: &str) -> bool {
        let Some(psnr) = mean_psnr(rows, psnr) else { return false };
        let mut all = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let [worst, best, sample] = all.entry((key.preset.clone(), key.method.clone())).or_default();
        let among = [(worst, psnr, WORST), (best, -psnr, BEST), (sample, draw(key), SAMPLE)];
        among.into_iter().fold(false, |admitted, (lowest, value, limit)| is_among(lowest, value, limit) || admitted)
    }
}

/// Whether a value is among the lowest so far; if so, it is recorded.
fn is_among(lowest: &mut Vec<f64>, value: f64, limit: usize) -> bool {
    let position = lowest.partition_point(|known| known.total_cmp(&value).is_lt());
    if position < limit {
        lowest.insert(position, value);
        lowest.truncate(limit);
    }
    position < limit
}

/// A random number that is the same for every method.
fn draw(key: &TrialKey) -> f64 {
    SplitMix64::for_scene(u64::from(key.entry), &key.scene).unit()
}

/// Removes images of trials that are kept for no method at the end of a run.
pub(super) fn prune(store: &Path, dataset: &Dataset, results: &Results) -> Result<(), EvalError> {
    let (preset, psnr) = (dataset.name.as_str(), dataset.preset.metrics.psnr);
    let methods: BTreeSet<&str> = results
        .trials
        .iter()
        .filter(|trial| trial.key.preset == preset)
        .map(|trial| trial.key.method.as_str())
        .collect();
    let kept: Vec<TrialKey> = methods.iter().flat_map(|method| chosen(results, preset, method, psnr)).collect();
    let mut without = 0;
    for key in &kept {
        without += u64::from(!images::has_images(store, key)?);
    }
    if without > 0 {
        tracing::warn!(preset, without, "trials that earlier runs evaluated without images have none");
    }
    for name in methods.into_iter().chain([TRUTH, CONTEXT]) {
        let folders = kept.iter().map(|key| images::folder(store, &key.of_method(name))).collect();
        retain(&images::folder_of_method(store, preset, name), &folders)?;
    }
    Ok(())
}

fn retain(folder: &Path, kept: &BTreeSet<PathBuf>) -> Result<(), EvalError> {
    let entries = entries_if_exists(folder).map_err(EvalError::io("reading images", folder))?;
    for path in entries.into_iter().filter(|path| path.is_dir() && !kept.contains(path)) {
        fs::remove_dir_all(&path).map_err(EvalError::io("removing images", &path))?;
    }
    Ok(())
}

/// Keys of a method's worst, best and typical trials.
fn chosen(results: &Results, preset: &str, method: &str, psnr: &str) -> BTreeSet<TrialKey> {
    let mut by_trial: BTreeMap<&TrialKey, Vec<TargetRow>> = BTreeMap::new();
    for row in results.targets_of(preset, method) {
        by_trial.entry(&row.key).or_default().push(row.clone());
    }
    let mut means: Vec<(f64, &TrialKey)> =
        by_trial.into_iter().filter_map(|(key, rows)| Some((mean_psnr(&rows, psnr)?, key))).collect();
    means.sort_by(|(a, _), (b, _)| a.total_cmp(b));
    let middle = median(means.iter().map(|(mean, _)| *mean)).unwrap_or(0.0);
    let mut sample = means.clone();
    sample.sort_by(|(_, a), (_, b)| draw(a).total_cmp(&draw(b)));
    sample.truncate(SAMPLE);
    sample.sort_by(|(a, _), (b, _)| (a - middle).abs().total_cmp(&(b - middle).abs()));
    let extremes = means.iter().take(WORST).chain(means.iter().rev().take(BEST));
    extremes.chain(sample.iter().take(TYPICAL)).map(|(_, key)| (*key).clone()).collect()
}

/// Mean of the protocol's PSNR variant over the targets that have one; where it was not asked for, of the first variant.
fn mean_psnr(rows: &[TargetRow], psnr: &str) -> Option<f64> {
    let score = |row: &TargetRow| {
        let any = || row.scores.iter().find(|(id, _)| is_psnr(id));
        row.scores.iter().find(|(id, _)| *id == psnr).or_else(any).map(|(_, score)| *score)
    };
    mean(rows.iter().filter_map(score))
}

#[cfg(test)]
mod tests {
    use atsplat_results::TargetStatus;

    use super::*;

    #[test]
    fn without_the_protocols_variant_the_first_other_psnr_decides() {
        let row = |scores: &[(&str, f64)]| TargetRow {
            key: TrialKey { preset: "p".to_owned(), method: "m".to_owned(), scene: "a".to_owned(), entry: 0 },
            target: 0,
            frame: 5,
            signed_distance: 0,
            leaked: false,
            overlap: None,
            width: 8,
            height: 6,
            truth_hash: None,
            render_hash: None,
            status: TargetStatus::Scored,
            detail: None,
            non_finite: 0,
            scores: scores.iter().map(|(id, score)| ((*id).to_owned(), *score)).collect(),
            not_computed: BTreeMap::new(),
        };
        let mean = |scores: &[(&str, f64)]| mean_psnr(&[row(scores)], "psnr");
        let others = [("psnr-of-depth", 3.0), ("psnr-unclipped", 20.0), ("ssim", 0.5)];
        assert_eq!(mean(&others), Some(20.0), "another program's number is no PSNR of images");
        assert_eq!(mean(&[others[1], ("psnr", 21.0)]), Some(21.0));
        assert_eq!(mean(&[others[0], others[2]]), None);
    }

    #[test]
    fn images_that_are_not_kept_are_removed_or_it_is_an_error() {
        let root = tempfile::tempdir().unwrap();
        let folder = root.path().join("method");
        let [kept, other] = ["a-0", "b-0"].map(|name| folder.join(name));
        for path in [&kept, &other] {
            fs::create_dir_all(path).unwrap();
        }
        retain(&folder, &[kept.clone()].into()).unwrap();
        assert!(kept.exists() && !other.exists());
        retain(&root.path().join("none"), &BTreeSet::new()).unwrap();
        let file = root.path().join("file");
        fs::write(&file, "").unwrap();
        assert!(matches!(retain(&file, &BTreeSet::new()), Err(EvalError::Io(_))));
    }
}
