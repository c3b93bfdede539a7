//! Any bytes as an array of two images: images of the expected size, or a typed error.
#![no_main]

use atsplat_pixels::npy;
use libfuzzer_sys::fuzz_target;

fuzz_target!(|bytes: &[u8]| {
    let Ok(read) = npy::read(bytes, [2, 1, 3, 3]) else { return };
    assert!(read.images.iter().map(|image| (image.width(), image.height())).eq([(3, 1); 2]));
});
