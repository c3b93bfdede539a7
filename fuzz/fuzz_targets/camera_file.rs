//! Any bytes as a file of cameras, without a lens and with one for poses: cameras or a typed error.
#![no_main]

use std::path::PathBuf;
use std::sync::LazyLock;

use atsplat_camera::ImageSize;
use atsplat_scene::Warnings;
use atsplat_scene::camera_file::{LensOfPoses, read};
use libfuzzer_sys::fuzz_target;

/// A file of this process, in a folder of its own: what is beside a file can be read with it.
static FILE: LazyLock<PathBuf> = LazyLock::new(|| {
    let folder = std::env::temp_dir().join(format!("atsplat-fuzz-cameras-{}", std::process::id()));
    std::fs::create_dir_all(&folder).expect("temporary files can be written");
    folder.join("cameras.json")
});

fuzz_target!(|bytes: &[u8]| {
    std::fs::write(&*FILE, bytes).expect("temporary files can be written");
    let of_poses = LensOfPoses { fov: Some(60.0), size: Some(ImageSize { width: 64, height: 48 }) };
    for lens in [LensOfPoses::default(), of_poses] {
        if let Ok(cameras) = read(&FILE, None, lens, &mut Warnings::new()) {
            assert!(!cameras.is_empty());
        }
    }
});
