//! Any bytes into `decode` and `size_of`: an image within the limits or a typed error.
#![no_main]

use atsplat_pixels::{DecodeLimits, decode, encode_png, size_of};
use libfuzzer_sys::fuzz_target;

const LIMITS: DecodeLimits = DecodeLimits { max_width: 512, max_height: 512, max_bytes: 1 << 20 };

fuzz_target!(|bytes: &[u8]| {
    let size = size_of(bytes);
    if let Ok(image) = decode(bytes, &LIMITS) {
        assert_eq!(size.ok(), Some((image.width(), image.height())));
        assert!(image.samples().len() as u64 <= LIMITS.max_bytes);
        let again = encode_png(&image).and_then(|png| decode(&png, &LIMITS));
        assert_eq!(again.ok(), Some(image));
    }
});
