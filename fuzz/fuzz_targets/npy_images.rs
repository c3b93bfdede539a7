//! Any bytes as an array of two images, and as that of one of any size: images of the expected size, or a typed error.
#![no_main]

use atsplat_pixels::{DecodeLimits, npy};
use libfuzzer_sys::fuzz_target;

fuzz_target!(|bytes: &[u8]| {
    if let Ok(read) = npy::read(bytes, [2, 1, 3, 3]) {
        assert!(read.images.iter().map(|image| (image.width(), image.height())).eq([(3, 1); 2]));
    }
    if let Ok((image, stored)) = npy::read_render(bytes, &DecodeLimits::default()) {
        let samples = image.samples().len();
        assert!(samples > 0 && stored.is_none_or(|stored| stored.len() == samples));
    }
});
