//! Any bytes as a chunk of scenes, read to the last image byte.
#![no_main]

use std::hint::black_box;
use std::path::Path;

use atsplat_scene::torch::Chunk;
use atsplat_scene::{SharedBytes, Warnings};
use libfuzzer_sys::fuzz_target;

fuzz_target!(|bytes: &[u8]| {
    let file = SharedBytes::new(bytes.to_vec());
    let Ok(chunk) = Chunk::from_bytes(file, Path::new("fuzz.torch"), &mut Warnings::new()) else { return };
    for key in chunk.keys() {
        if let Ok(scene) = chunk.record(key) {
            for image in &scene.images {
                black_box(image.iter().fold(0u8, |sum, byte| sum.wrapping_add(*byte)));
            }
            scene.to_scene(Path::new("fuzz.torch")).ok();
        }
    }
});
