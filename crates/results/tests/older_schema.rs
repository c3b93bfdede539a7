//! Stores of older versions are read as far as they go.

use std::path::Path;

use atsplat_results::times::times;
use atsplat_results::{Results, Store};

/// Two baselines on two simulated yards, written when `--timing` put times into the rows (`atsplat run tiny.toml --data
/// data/test --method warp --method nearest-view --metrics psnr --timing`, schema version 1).
#[test]
fn times_of_an_older_schema_are_not_read() {
    let fixture = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/fixtures/store-v1");
    let results = Results::read(&fixture).unwrap();
    assert_eq!((results.trials.len(), results.targets.len(), results.timings.len()), (4, 8, 0));
    assert!(results.targets.iter().all(|row| row.scores.contains_key("psnr")), "everything else is read");
    let reason = times(&results, "tiny", "warp").unwrap_err();
    assert!(reason.contains("older atsplat") && reason.contains("--timing"), "{reason}");
    let copy = tempfile::tempdir().unwrap();
    for file in std::fs::read_dir(&fixture).unwrap().map(|file| file.unwrap()) {
        std::fs::copy(file.path(), copy.path().join(file.file_name())).unwrap();
    }
    let error = Store::resume(copy.path(), results.provenance.clone()).unwrap_err().to_string();
    assert!(error.contains("schema versions") && error.contains("another folder"), "{error}");
    let merged = Results::merge(vec![results.clone()]).unwrap().results;
    assert_eq!((merged.trials, merged.timings.len()), (results.trials, 0));
}
