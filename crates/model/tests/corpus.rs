//! Replays the corpora of the fuzz targets `model_toml` and `weights_file`, as far as the latter's tensors are imported.

#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

use std::path::PathBuf;

use atsplat_model::budget::{budget, memory};
use atsplat_model::config::ModelConfig;
use atsplat_model::parameters::Parameter;
use atsplat_model::weights::{KeyMap, ModelWeights, StoredTensor, StoredTensors};
use atsplat_pickle::SharedBytes;

/// The inputs of one target.
fn inputs(target: &str) -> impl Iterator<Item = Vec<u8>> {
    let folder = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../fuzz/corpus").join(target);
    std::fs::read_dir(folder).unwrap().map(|entry| std::fs::read(entry.unwrap().path()).unwrap())
}

#[test]
fn configurations_round_trip_and_have_a_budget_and_key_maps_parse() {
    let (mut configurations, mut maps) = (0, 0);
    for bytes in inputs("model_toml") {
        let text = String::from_utf8_lossy(&bytes);
        maps += usize::from(KeyMap::from_toml(&text).is_ok());
        let Ok(config) = ModelConfig::from_toml(&text) else { continue };
        assert_eq!(ModelConfig::from_toml(&config.to_toml().unwrap()).unwrap(), config);
        budget(&config, config.views, config.resolution).unwrap();
        memory(&config, config.views, config.resolution).unwrap();
        configurations += 1;
    }
    assert!(configurations >= 2 && maps >= 1, "{configurations} configurations and {maps} key maps are valid");
}

#[test]
fn weights_files_are_imported_under_every_key_map() {
    let (mut imported, mut errors) = (0, 0);
    for bytes in inputs("weights_file") {
        let Ok(stored) = StoredTensors::parse(SharedBytes::new(bytes)) else { continue };
        errors += usize::from(ModelWeights::from_stored(&stored).is_err());
        let parameter = |(name, tensor): (&String, &StoredTensor)| Parameter {
            name: name.clone(),
            shape: tensor.shape().to_vec(),
            trained: true,
        };
        let expected: Vec<Parameter> = stored.tensors.iter().map(parameter).collect();
        for name in KeyMap::names() {
            let map = KeyMap::resolve(name).unwrap();
            let (found, _) = map.apply(&stored, &expected);
            imported += found.tensors.len();
            map.export(&found).ok();
        }
        if let Some(text) = stored.metadata.get("configuration") {
            ModelConfig::from_toml(text).ok();
        }
    }
    assert!(imported > 0 && errors > 0, "{imported} tensors imported, {errors} files without a configuration");
}
