//! Any text gives a preset or an error; a preset that was read is written and read back the same.

#![no_main]

use atsplat_protocol::Preset;
use libfuzzer_sys::fuzz_target;

fuzz_target!(|text: &str| {
    let Ok(preset) = Preset::from_toml(text) else { return };
    let written = preset.to_toml().expect("what was read can be written");
    let again = Preset::from_toml(&written).expect("what was written is a preset");
    assert_eq!(again, preset);
    assert_eq!(again.hash().expect("hash"), preset.hash().expect("hash"));
});
