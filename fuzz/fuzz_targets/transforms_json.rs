#![no_main]

use std::path::Path;

use atsplat_scene::nerfstudio::parse_transforms;
use libfuzzer_sys::fuzz_target;

fuzz_target!(|bytes: &[u8]| {
    let _ = parse_transforms(bytes, Path::new("fuzz.json"));
});
