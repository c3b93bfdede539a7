//! Any bytes as a file of weights, imported to the last number.
#![no_main]

use atsplat_model::config::ModelConfig;
use atsplat_model::parameters::Parameter;
use atsplat_model::weights::{KeyMap, ModelWeights, StoredTensors};
use atsplat_pickle::SharedBytes;
use libfuzzer_sys::fuzz_target;

fuzz_target!(|bytes: &[u8]| {
    let Ok(stored) = StoredTensors::parse(SharedBytes::new(bytes.to_vec())) else { return };
    ModelWeights::from_stored(&stored).ok();
    let expected: Vec<Parameter> = stored
        .tensors
        .iter()
        .take(64)
        .map(|(name, tensor)| Parameter { name: name.clone(), shape: tensor.shape().to_vec(), trained: true })
        .collect();
    for map in KeyMap::names().filter_map(|name| KeyMap::resolve(name).ok()) {
        let (found, _) = map.apply(&stored, &expected);
        map.export(&found).ok();
    }
    // What was read can be written, and is the same when it is read again.
    let written = stored.to_safetensors().expect("names come from a file");
    let again = StoredTensors::parse(SharedBytes::new(written)).expect("we wrote it");
    assert_eq!(again.digest(), stored.digest());
    if let Some(text) = stored.metadata.get("configuration") {
        ModelConfig::from_toml(text).ok();
    }
});
