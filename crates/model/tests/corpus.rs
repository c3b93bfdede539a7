//! Replays every input in the corpus of the fuzz target `model_toml`.

use std::path::PathBuf;

use atsplat_model::config::ModelConfig;
use atsplat_model::weights::KeyMap;

#[test]
fn configurations_round_trip_and_key_maps_parse() {
    let mut read = 0;
    let folder = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../fuzz/corpus/model_toml");
    for entry in std::fs::read_dir(folder).unwrap() {
        let bytes = std::fs::read(entry.unwrap().path()).unwrap();
        let text = String::from_utf8_lossy(&bytes);
        read += usize::from(KeyMap::from_toml(&text).is_ok());
        if let Ok(config) = ModelConfig::from_toml(&text) {
            assert_eq!(ModelConfig::from_toml(&config.to_toml().unwrap()).unwrap(), config);
            read += 1;
        }
    }
    assert!(read >= 3, "some inputs are valid files");
}
