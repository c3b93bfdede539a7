//! Any text as a model configuration, and as a key map.
#![no_main]

use std::hint::black_box;

use atsplat_model::budget::{budget, memory};
use atsplat_model::config::ModelConfig;
use atsplat_model::weights::KeyMap;
use libfuzzer_sys::fuzz_target;

fuzz_target!(|bytes: &[u8]| {
    let Ok(text) = std::str::from_utf8(bytes) else { return };
    black_box(KeyMap::from_toml(text)).ok();
    let Ok(config) = ModelConfig::from_toml(text) else { return };
    assert_eq!(ModelConfig::from_toml(&config.to_toml().expect("it was TOML")).expect("we wrote it"), config);
    budget(&config, config.views, config.resolution).expect("validated");
    if config.decoder.blocks.iter().map(|block| block.layers).sum::<usize>() < 64 {
        memory(&config, config.views, config.resolution).expect("validated");
    }
});
