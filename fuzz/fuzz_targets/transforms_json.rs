//! Any bytes as a `transforms.json` without images: cameras or a typed error.
#![no_main]

use std::path::PathBuf;
use std::sync::LazyLock;

use atsplat_scene::nerfstudio::{NerfstudioOptions, NerfstudioScenes, parse_transforms};
use atsplat_scene::{SceneSource as _, Warnings};
use libfuzzer_sys::fuzz_target;

/// Lenses are completed only when a scene is loaded, which takes a file: one of this process, in a folder of its own.
static FILE: LazyLock<PathBuf> = LazyLock::new(|| {
    let folder = std::env::temp_dir().join(format!("atsplat-fuzz-{}", std::process::id()));
    std::fs::create_dir_all(&folder).expect("temporary files can be written");
    folder.join("transforms.json")
});

fuzz_target!(|bytes: &[u8]| {
    if parse_transforms(bytes, &FILE).is_err() {
        return;
    }
    std::fs::write(&*FILE, bytes).expect("temporary files can be written");
    let scenes = NerfstudioScenes::open(&FILE, NerfstudioOptions::default(), &mut Warnings::new()).expect("a file");
    scenes.load(&scenes.keys()[0], &mut Warnings::new()).ok();
});
