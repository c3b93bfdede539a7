//! Decoding compared with Pillow's `convert("RGB")` (`fixtures/make_images.py`).
#![expect(clippy::unwrap_used, clippy::panic, reason = "an invalid fixture fails the test")]

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use atsplat_files::Sha256Digest;
use atsplat_pixels::{DecodeLimits, Orientation, PixelError, decode, encode_jpeg, size_of};

#[test]
fn decoding_matches_pillow_bit_for_bit() {
    let mut wrong = String::new();
    for (name, size, expected) in golden() {
        let bytes = std::fs::read(folder().join(&name)).unwrap();
        assert_eq!(size_of(&bytes).unwrap(), size, "{name}");
        let image = decode(&bytes, &DecodeLimits::default()).unwrap_or_else(|error| panic!("{name}: {error}"));
        if Sha256Digest::of(image.samples()) != expected {
            writeln!(wrong, "{name}").unwrap();
        }
    }
    assert!(wrong.is_empty(), "differ from Pillow:\n{wrong}");
}

/// Pillow wrote an orientation into one file; its pixels are decoded as stored.
#[test]
fn orientations_are_read_but_not_applied() {
    let orientation = |name: &str| Orientation::of(&std::fs::read(folder().join(name)).unwrap());
    assert_eq!(orientation("exif_orientation_is_ignored.jpg"), Some(Orientation::Clockwise));
    let others = golden().into_iter().filter(|(name, _, _)| !name.starts_with("exif"));
    assert!(others.into_iter().all(|(name, _, _)| orientation(&name).is_none()));
}

/// The image that `make_images.py` saved as JPEG is also in `lossless.webp`.
#[test]
fn jpeg_encoding_matches_pillow_bit_for_bit() {
    let read = |name: &str| std::fs::read(folder().join(name)).unwrap();
    let scene = decode(&read("lossless.webp"), &DecodeLimits::default()).unwrap();
    for quality in [20, 75, 98] {
        let pillows = read(&format!("baseline_420_q{quality}.jpg"));
        assert_eq!(encode_jpeg(&scene, quality).unwrap(), pillows, "quality {quality}");
    }
    for quality in [0, 101] {
        assert!(matches!(encode_jpeg(&scene, quality), Err(PixelError::Quality { .. })));
    }
}

fn folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/fixtures/images")
}

fn golden() -> Vec<(String, (u32, u32), Sha256Digest)> {
    let text = std::fs::read_to_string(folder().with_extension("csv")).unwrap();
    let lines = text.lines().filter(|line| !line.starts_with('#'));
    lines
        .map(|line| {
            let fields: Vec<&str> = line.split(',').collect();
            let [name, width, height, digest] = fields[..] else { panic!("{line}") };
            (name.to_owned(), (width.parse().unwrap(), height.parse().unwrap()), digest.parse().unwrap())
        })
        .collect()
}
