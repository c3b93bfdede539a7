//! Baselines whose parts disagree, as after an edit or a merge by hand.

use serde_json::Value;

use super::*;

fn error_after(change: impl Fn(&mut Value)) -> Option<String> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("b.json");
    let first = baseline_of(&store(true, 4, 0.3, 1));
    first.accept(&store(true, 4, 0.3, 2), &[], acceptance("second")).write(&path).unwrap();
    let mut file: Value = serde_json::from_slice(&std::fs::read(&path).unwrap()).unwrap();
    change(&mut file);
    std::fs::write(&path, file.to_string()).unwrap();
    Baseline::read(&path).err().map(|error| error.to_string())
}

fn remove(file: &mut Value, list: &str, at: usize) {
    file[list].as_array_mut().unwrap().remove(at);
}

/// What is done to the file.
type Change = fn(&mut Value);

#[test]
fn a_baseline_that_lost_rows_is_rejected() {
    assert_eq!(error_after(|_| ()), None);
    let lost_trial = "trials: expected the trial of each target, found no trial ";
    let lost_image = "images: expected the image of each target, found none of sampled, scene scene 000, frame ";
    let lost_target =
        "targets: expected target 1 of m on sampled, scene \"scene 000\", entry 0, found target 2 instead";
    let other_mean = " as psnr of m under sampled, which is the mean of its targets, found ";
    let cases: [(&str, Change); 9] = [
        (lost_trial, |file| file["trials"] = Value::Array(Vec::new())),
        (lost_trial, |file| remove(file, "trials", 2)),
        (lost_image, |file| file["images"] = Value::Array(Vec::new())),
        (lost_image, |file| file["targets"][0]["frame"] = 29.into()),
        (lost_image, |file| file["targets"][1]["truth_hash"] = "other".into()),
        (lost_target, |file| remove(file, "targets", 1)),
        (other_mean, |file| remove(file, "targets", 2)),
        (other_mean, |file| file["targets"][4]["scores"]["psnr"] = 22.5.into()),
        (other_mean, |file| file["numbers"][1]["mean"] = 23.5.into()),
    ];
    for (at, (expected, change)) in cases.into_iter().enumerate() {
        let error = error_after(change).unwrap_or_default();
        assert!(error.contains(expected), "{at}: {error}");
    }
    let lost = error_after(|file| remove(file, "numbers", 1)).unwrap();
    assert!(lost.contains("is the mean of its targets, found none ("), "{lost}");
}

/// Adds a method that failed in all trials, whose targets are the thirteenth to the last.
fn with_failures(file: &mut Value) {
    for list in ["trials", "targets"] {
        let mut failed = file[list].as_array().unwrap().clone();
        for row in &mut failed {
            row["method"] = "n".into();
            row["status"] = "failed".into();
            if list == "targets" {
                row["scores"] = Value::Object(serde_json::Map::new());
            }
        }
        file[list].as_array_mut().unwrap().extend(failed);
    }
}

/// No mean says that they are gone.
#[test]
fn a_baseline_that_lost_targets_without_scores_is_rejected() {
    assert_eq!(error_after(with_failures), None);
    let left = |removed: usize| {
        error_after(|file| {
            with_failures(file);
            (0..removed).for_each(|removed| remove(file, "targets", 14 - removed));
        })
    };
    for (removed, found) in [(1, 2), (3, 0)] {
        let error = left(removed).unwrap();
        let expected =
            "targets: expected as many targets of n on sampled, scene \"scene 000\", entry 0 as of m, 3, found ";
        assert!(error.contains(&format!("{expected}{found}")), "{removed}: {error}");
    }
    let gap = error_after(|file| {
        with_failures(file);
        remove(file, "targets", 12);
    });
    assert!(gap.is_some_and(|gap| gap.contains("expected target 0 of n on sampled")));
}
