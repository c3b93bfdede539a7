//! Presets of stored results and baselines, which older versions wrote, keep their hashes.

#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

use std::fs;
use std::path::{Path, PathBuf};

use atsplat_protocol::Preset;
use serde_json::Value;

/// The JSON files below a folder.
fn json_below(folder: &Path, found: &mut Vec<PathBuf>) {
    for path in fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()) {
        if path.is_dir() {
            json_below(&path, found);
        } else if path.extension().is_some_and(|extension| extension == "json") {
            found.push(path);
        }
    }
}

/// The hash and the text of every preset in a file of results.
fn presets<'a>(value: &'a Value, found: &mut Vec<(&'a str, &'a str)>) {
    match value {
        Value::Object(fields) => {
            let text = |name: &str| fields.get(name).and_then(Value::as_str);
            found.extend(text("hash").zip(text("toml")));
            fields.values().for_each(|field| presets(field, found));
        }
        Value::Array(items) => items.iter().for_each(|item| presets(item, found)),
        _ => {}
    }
}

#[test]
fn stored_presets_are_read_with_the_hashes_of_their_results() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
    let mut files = Vec::new();
    for folder in ["reports", "eval/baselines", "crates/results/tests/fixtures"] {
        json_below(&root.join(folder), &mut files);
    }
    let (mut all, mut in_sigmas) = (0, 0);
    for path in files {
        let Ok(json) = serde_json::from_slice::<Value>(&fs::read(&path).unwrap()) else { continue };
        let mut stored = Vec::new();
        presets(&json, &mut stored);
        for (hash, text) in stored {
            let preset = Preset::from_toml(text).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
            assert_eq!(preset.hash().unwrap().to_string(), hash, "{}", path.display());
            // Written by this version, it is the same protocol.
            let again = Preset::from_toml(&preset.to_toml().unwrap()).unwrap();
            assert_eq!((&again, again.hash().unwrap()), (&preset, preset.hash().unwrap()), "{}", path.display());
            (all, in_sigmas) = (all + 1, in_sigmas + usize::from(text.contains("extent-sigmas")));
        }
    }
    // Reports and baselines are written again by later versions; `store-v1` of the fixtures stays as it is.
    assert!(all > 0 && in_sigmas > 0, "{in_sigmas} of {all} presets are of older versions");
}
