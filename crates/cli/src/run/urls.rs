//! Results on data in object storage, without the places of copies.

use std::collections::BTreeSet;
use std::path::Path;

use atsplat_eval::runner::Findings;
use atsplat_results::{Results, ResultsError, Store, TargetRow, TrialKey, TrialRow};

use crate::objects::{has_copies, with_urls};

/// Puts URLs in place of the paths of copies in the warnings, skipped entries and rows of a store that was just finished, as stores
/// are compared between machines.
pub(crate) fn name_urls(folder: &Path, results: Results) -> Result<Results, ResultsError> {
    if !has_copies() {
        return Ok(results);
    }
    let findings = Findings {
        warnings: results.provenance.warnings.iter().map(|found| renamed(found, |found| &mut found.example)).collect(),
        skipped: results.provenance.skipped.iter().map(|entry| renamed(entry, |entry| &mut entry.detail)).collect(),
    };
    let trials = results.trials.iter().filter(|row| with(*row, of_trial) != **row).map(|row| &row.key);
    let targets = results.targets.iter().filter(|row| with(*row, of_target) != **row).map(|row| &row.key);
    let keys: BTreeSet<TrialKey> = trials.chain(targets).cloned().collect();
    let before = (&results.provenance.warnings, &results.provenance.skipped);
    if keys.is_empty() && before == (&findings.warnings, &findings.skipped) {
        return Ok(results);
    }
    let mut store = Store::open(folder)?;
    for row in results.trials.iter().filter(|row| keys.contains(&row.key)) {
        let of_row = results.targets.iter().filter(|target| target.key == row.key);
        let targets: Vec<TargetRow> = of_row.map(|target| with(target, of_target)).collect();
        store.append(&with(row, of_trial), &targets)?;
    }
    store.set_findings(findings.warnings, findings.skipped);
    store.finish()
}

/// A copy in which one text names URLs.
fn renamed<T: Clone>(value: &T, text: impl Fn(&mut T) -> &mut String) -> T {
    let mut value = value.clone();
    let named = with_urls(text(&mut value));
    *text(&mut value) = named;
    value
}

fn with<T: Clone>(row: &T, name_urls: impl Fn(&mut T)) -> T {
    let mut row = row.clone();
    name_urls(&mut row);
    row
}

fn of_trial(row: &mut TrialRow) {
    for text in row.detail.iter_mut().chain(&mut row.notes) {
        *text = with_urls(text);
    }
}

fn of_target(row: &mut TargetRow) {
    for text in row.detail.iter_mut().chain(row.not_computed.values_mut()) {
        *text = with_urls(text);
    }
}

#[cfg(test)]
mod tests {
    use atsplat_results::{Provenance, SkippedEntry, WarningCount};
    use serde_json::json;

    use super::*;
    use crate::objects::note_copy;

    #[test]
    fn stores_name_urls_and_not_the_copies_that_were_read() {
        let folder = tempfile::tempdir().unwrap();
        let copy = "/nowhere/trees/33/data";
        note_copy(Path::new(copy), "s3://b/data");
        let key = json!({ "preset": "p", "method": "warp", "scene": "s", "entry": 0 });
        let mut trial = json!({
            "trial_hash": "00", "pose_hash": "00", "status": "failed", "detail": format!("no image ({copy}/0.png)"),
            "context": [0], "targets": 0, "width": 8, "height": 8, "effects": [], "notes": [format!("in {copy}")]
        });
        trial.as_object_mut().unwrap().extend(key.as_object().unwrap().clone());
        let warning = WarningCount {
            preset: "p".to_owned(),
            kind: "missing-image".to_owned(),
            count: 2,
            example: format!("s: {copy}/0.png"),
        };
        let skipped = SkippedEntry {
            preset: "p".to_owned(),
            scene: "t".to_owned(),
            detail: format!("cut short ({copy}/1.png)"),
            ..SkippedEntry::default()
        };
        let provenance = Provenance { warnings: vec![warning], skipped: vec![skipped], ..Provenance::default() };
        let trials = vec![serde_json::from_value(trial).unwrap()];
        let store = folder.path().join("store");
        Results { provenance, trials, ..Results::default() }.write(&store).unwrap();
        name_urls(&store, Results::read(&store).unwrap()).unwrap();
        let Results { provenance, trials, .. } = Results::read(&store).unwrap();
        assert_eq!(provenance.warnings[0].example, "s: s3://b/data/0.png");
        assert_eq!(provenance.skipped[0].detail, "cut short (s3://b/data/1.png)");
        assert_eq!(trials[0].detail.as_deref(), Some("no image (s3://b/data/0.png)"));
        assert_eq!(trials[0].notes, ["in s3://b/data"]);
    }
}
