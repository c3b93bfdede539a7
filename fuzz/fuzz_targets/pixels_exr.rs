//! Any bytes into `exr::read`: planes within the limits or a typed error, and what was read can be written,
//! unless a channel has a name that is only read.
#![no_main]

use atsplat_pixels::{DecodeLimits, PixelError, exr, size_of};
use libfuzzer_sys::fuzz_target;

const LIMITS: DecodeLimits = DecodeLimits { max_width: 256, max_height: 256, max_bytes: 1 << 19 };

fuzz_target!(|bytes: &[u8]| {
    let size = size_of(bytes);
    let _ = exr::read_rgb(bytes, &LIMITS);
    if let Ok(channels) = exr::read(bytes, &LIMITS) {
        assert_eq!(size.ok(), Some((channels.width(), channels.height())));
        let file = match exr::write(&channels) {
            Err(PixelError::ChannelName { .. }) => return,
            outcome => outcome.expect("what was read can be written"),
        };
        let again = exr::read(&file, &LIMITS).expect("what was written can be read");
        for (first, second) in channels.channels().iter().zip(again.channels()) {
            assert_eq!(first.name, second.name);
            assert!(first.samples.iter().zip(&second.samples).all(|(a, b)| a.to_bits() == b.to_bits()));
        }
    }
});
