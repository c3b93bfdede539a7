#![no_main]

use std::path::Path;

use atsplat_scene::colmap::{Encoding, parse_cameras, parse_images, parse_points};
use libfuzzer_sys::fuzz_target;

// The first byte picks one of the model's three files.
fuzz_target!(|bytes: &[u8]| {
    let Some((file, bytes)) = bytes.split_first() else { return };
    let path = Path::new("fuzz");
    match file % 3 {
        0 => drop(
            parse_cameras(bytes, Encoding::Binary, path)
                .map(|cameras| cameras.values().map(|camera| camera.lens("fuzz", path)).filter(Result::is_ok).count()),
        ),
        1 => drop(parse_images(bytes, Encoding::Binary, path)),
        _ => drop(parse_points(bytes, Encoding::Binary, path)),
    }
});
