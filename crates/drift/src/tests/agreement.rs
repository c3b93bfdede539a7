//! Baselines whose parts disagree, as after an edit or a merge by hand.

use serde_json::Value;

use super::*;

fn error_after(change: impl Fn(&mut Value)) -> Option<String> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("b.json");
    let first = Baseline::new(&store(true, 4, 0.3, 1), &[], acceptance("first"));
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
    let other_mean = " as psnr of m under sampled, which is the mean of its targets, found ";
    let cases: [(&str, Change); 8] = [
        (lost_trial, |file| file["trials"] = Value::Array(Vec::new())),
        (lost_trial, |file| remove(file, "trials", 2)),
        (lost_image, |file| file["images"] = Value::Array(Vec::new())),
        (lost_image, |file| file["targets"][0]["frame"] = 29.into()),
        (lost_image, |file| file["targets"][1]["truth_hash"] = "other".into()),
        (other_mean, |file| remove(file, "targets", 1)),
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
