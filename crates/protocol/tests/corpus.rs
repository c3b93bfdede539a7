//! Replays the corpora of the fuzz targets, which contain every input that once broke a parser, without a fuzzer.

#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

use std::fs;
use std::path::{Path, PathBuf};

use atsplat_protocol::{IndexFile, LintOptions, Preset, lint_file};
use atsplat_scene::Warnings;

fn inputs(target: &str) -> Vec<(PathBuf, Vec<u8>)> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../fuzz/corpus").join(target);
    let mut paths: Vec<PathBuf> = fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()).collect();
    paths.sort();
    assert!(!paths.is_empty(), "{target} has seeds");
    paths.into_iter().map(|path| (path.clone(), fs::read(path).unwrap())).collect()
}

#[test]
fn evaluation_index() {
    for (path, bytes) in inputs("evaluation_index") {
        let Ok(file) = IndexFile::parse(&bytes) else { continue };
        let again = IndexFile::parse(file.index.to_json(&file.layout).as_bytes()).unwrap();
        assert_eq!(again.index, file.index, "{}", path.display());
    }
}

#[test]
fn preset_toml() {
    for (path, bytes) in inputs("preset_toml") {
        let Ok(text) = std::str::from_utf8(&bytes) else { continue };
        let Ok(preset) = Preset::from_toml(text) else { continue };
        let again = Preset::from_toml(&preset.to_toml().unwrap()).unwrap();
        assert_eq!(again, preset, "{}", path.display());
    }
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
