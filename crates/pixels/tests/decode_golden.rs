//! Decoding against Pillow's `convert("RGB")` (`fixtures/make_pictures.py`), and damaged input.
#![expect(clippy::unwrap_used, clippy::panic, reason = "a fixture that does not parse fails the test")]

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use atsplat_pixels::{DecodeLimits, PictureFormat, PixelError, decode, size_of};
use sha2::{Digest, Sha256};

/// libwebp shifts chroma between samples with other rounding than `image-webp` (largest difference in levels).
const LOSSY_WEBP: &str = "lossy";

#[test]
fn the_same_bits_as_pillow() {
    let mut wrong = String::new();
    for (name, size, expected) in golden() {
        let bytes = std::fs::read(folder().join(&name)).unwrap();
        assert_eq!(size_of(&bytes).unwrap(), size, "{name}");
        let image = decode(&bytes, &DecodeLimits::default()).unwrap_or_else(|error| panic!("{name}: {error}"));
        let found = Sha256::digest(image.samples()).iter().fold(String::new(), |mut text, byte| {
            write!(text, "{byte:02x}").unwrap();
            text
        });
        if found != expected {
            writeln!(wrong, "{name}").unwrap();
        }
    }
    assert!(wrong.is_empty(), "differ from Pillow:\n{wrong}");
}

fn folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/fixtures/pictures")
}

fn golden() -> Vec<(String, (u32, u32), String)> {
    let text = std::fs::read_to_string(folder().with_extension("csv")).unwrap();
    let lines = text.lines().filter(|line| !line.starts_with('#'));
    lines
        .map(|line| {
            let fields: Vec<&str> = line.split(',').collect();
            let [name, width, height, digest] = fields[..] else { panic!("{line}") };
            (name.to_owned(), (width.parse().unwrap(), height.parse().unwrap()), digest.to_owned())
        })
        .collect()
}
