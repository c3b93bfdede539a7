use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

use super::pictures::{self, CONTEXT, TRUTH};
use crate::{EvalError, Results, TargetRow, TrialKey};

/// Number of trials whose pictures are kept with [`super::KeepPictures::Worst`].
const WORST: usize = 10;

/// The lowest mean PSNRs of each method under each preset so far.
///
/// A trial that is among the worst at the end was among the worst when it was evaluated, so its pictures were stored; the
/// others' pictures are removed by [`prune`].
#[derive(Debug, Default)]
pub(super) struct WorstSoFar(Mutex<BTreeMap<(String, String), Vec<f64>>>);

impl WorstSoFar {
    /// Whether a trial is among the worst so far; if so, it is recorded.
    pub(super) fn admits(&self, key: &TrialKey, rows: &[TargetRow]) -> bool {
        let Some(mean) = mean_psnr(rows) else { return false };
        let mut all = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let lowest = all.entry((key.preset.clone(), key.method.clone())).or_default();
        let position = lowest.partition_point(|known| known.total_cmp(&mean).is_lt());
        if position >= WORST {
            return false;
        }
        lowest.insert(position, mean);
        lowest.truncate(WORST);
        true
    }
}

/// Removes pictures of trials that are not among the worst at the end of a run.
pub(super) fn prune(store: &Path, preset: &str, results: &Results) -> Result<(), EvalError> {
    let methods: BTreeSet<&str> = results
        .trials
        .iter()
        .filter(|trial| trial.key.preset == preset)
        .map(|trial| trial.key.method.as_str())
        .collect();
    let folder = |key: &TrialKey| pictures::folder(store, key);
    let mut common = BTreeSet::new();
    for method in methods {
        let worst = worst(results, preset, method);
        common.extend(worst.iter().flat_map(|key| [TRUTH, CONTEXT].map(|name| folder(&key.of_method(name)))));
        retain(&pictures::folder_of_method(store, preset, method), &worst.iter().map(folder).collect())?;
    }
    for name in [TRUTH, CONTEXT] {
        retain(&pictures::folder_of_method(store, preset, name), &common)?;
    }
    Ok(())
}

fn retain(folder: &Path, kept: &BTreeSet<PathBuf>) -> Result<(), EvalError> {
    let Ok(entries) = fs::read_dir(folder) else { return Ok(()) };
    for path in entries.flatten().map(|entry| entry.path()).filter(|path| !kept.contains(path)) {
        fs::remove_dir_all(&path).map_err(EvalError::io("removing pictures", &path))?;
    }
    Ok(())
}

/// Keys of the trials with the lowest mean PSNR, the worst first.
fn worst(results: &Results, preset: &str, method: &str) -> Vec<TrialKey> {
    let mut rows: BTreeMap<&TrialKey, Vec<TargetRow>> = BTreeMap::new();
    for row in results.targets.iter().filter(|row| row.key.preset == preset && row.key.method == method) {
        rows.entry(&row.key).or_default().push(row.clone());
    }
    let mut means: Vec<(f64, &TrialKey)> =
        rows.into_iter().filter_map(|(key, rows)| Some((mean_psnr(&rows)?, key))).collect();
    means.sort_by(|(a, _), (b, _)| a.total_cmp(b));
    means.into_iter().take(WORST).map(|(_, key)| key.clone()).collect()
}

/// Mean of the protocol's PSNR variant over the targets that have one.
fn mean_psnr(rows: &[TargetRow]) -> Option<f64> {
    let score = |row: &TargetRow| row.scores.iter().find(|(id, _)| id.starts_with("psnr")).map(|(_, score)| *score);
    let scores: Vec<f64> = rows.iter().filter_map(score).collect();
    (!scores.is_empty()).then(|| scores.iter().sum::<f64>() / scores.len() as f64)
}
