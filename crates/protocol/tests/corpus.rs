//! Replays the corpora of the fuzz targets, which contain every input that once broke a parser, without a fuzzer.

#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

use std::path::{Path, PathBuf};

use atsplat_protocol::{IndexFile, LintOptions, Preset, lint_file};
use atsplat_scene::Warnings;

/// Runs `accepts` on each input of one target, whose corpus contains valid and invalid ones.
fn replay(target: &str, accepts: impl Fn(&[u8], &Path) -> bool) {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../fuzz/corpus").join(target);
    let mut inputs: Vec<PathBuf> = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()).collect();
    inputs.sort();
    let accepted = inputs.iter().filter(|path| accepts(&std::fs::read(path).unwrap(), path)).count();
    assert!(accepted >= 2 && accepted < inputs.len(), "{target}: {accepted} of {} accepted", inputs.len());
}

#[test]
fn evaluation_index() {
    replay("evaluation_index", |bytes, path| {
        let Ok(file) = IndexFile::parse(bytes) else { return false };
        let again = IndexFile::parse(file.index.to_json(&file.layout).as_bytes()).unwrap();
        assert_eq!(again.index, file.index, "{}", path.display());
        assert_eq!(again.index.content_hash(), file.index.content_hash(), "{}", path.display());
        let report = lint_file(&file, &LintOptions::default(), &mut Warnings::new());
        assert_eq!(report.targets, file.index.target_count() as u64, "{}", path.display());
        let parts = [&report.leaked, &report.outside_window];
        assert!(parts.iter().all(|part| part.targets <= report.targets), "{}", path.display());
        assert!(!report.to_string().contains("NaN"), "{}", path.display());
        true
    });
}

#[test]
fn preset_toml() {
    replay("preset_toml", |bytes, path| {
        let Ok(text) = std::str::from_utf8(bytes) else { return false };
        let Ok(preset) = Preset::from_toml(text) else { return false };
        let again = Preset::from_toml(&preset.to_toml().unwrap()).unwrap();
        assert_eq!(again, preset, "{}", path.display());
        assert_eq!(again.hash().unwrap(), preset.hash().unwrap(), "{}", path.display());
        true
    });
}

#[test]
fn the_example_index_contains_every_case() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../eval/indices/example.json");
    let file = IndexFile::read(&path).unwrap();
    let report = lint_file(&file, &LintOptions::default(), &mut Warnings::new());
    assert_eq!((report.keys, report.null, report.leaked.targets, report.outside_window.targets), (8, 1, 1, 1));
    let overlap = report.overlap.unwrap();
    assert_eq!(overlap.published.to_string(), "small 1, medium 3, large 2, above range 1");
    assert_eq!(overlap.strict.to_string(), "small 1, medium 2, large 2, below range 1, above range 1");
}
