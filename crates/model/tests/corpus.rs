//! Replays every input in the corpora of the fuzz targets `weights_file` and `model_toml`.

#![expect(clippy::unwrap_used, clippy::panic, reason = "helpers of tests fail like tests")]

use std::path::PathBuf;

use atsplat_model::config::ModelConfig;
use atsplat_model::weights::{KeyMap, StoredTensors};
use atsplat_pickle::SharedBytes;

fn inputs(target: &str) -> Vec<Vec<u8>> {
    let folder = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../fuzz/corpus").join(target);
    let listed = std::fs::read_dir(&folder).unwrap_or_else(|error| panic!("{error} ({})", folder.display()));
    let mut paths: Vec<PathBuf> = listed.map(|entry| entry.unwrap().path()).collect();
    paths.sort();
    assert!(!paths.is_empty(), "{target} has seeds");
    paths.iter().map(|path| std::fs::read(path).unwrap()).collect()
}

#[test]
fn weights_files_round_trip() {
    let mut read = 0;
    for bytes in inputs("weights_file") {
        let Ok(stored) = StoredTensors::parse(SharedBytes::new(bytes)) else { continue };
        let rewritten = StoredTensors::parse(SharedBytes::new(stored.to_safetensors().unwrap())).unwrap();
        assert_eq!(rewritten.digest(), stored.digest());
        read += 1;
    }
    assert!(read >= 4, "some inputs are valid files");
}

#[test]
fn configurations_round_trip_and_key_maps_parse() {
    let mut read = 0;
    for bytes in inputs("model_toml") {
        let text = String::from_utf8_lossy(&bytes);
        read += usize::from(KeyMap::from_toml(&text).is_ok());
        if let Ok(config) = ModelConfig::from_toml(&text) {
            assert_eq!(ModelConfig::from_toml(&config.to_toml().unwrap()).unwrap(), config);
            read += 1;
        }
    }
    assert!(read >= 3, "some inputs are valid files");
}
