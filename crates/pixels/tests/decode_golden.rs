//! Decoding against Pillow's `convert("RGB")` (`fixtures/make_pictures.py`), and damaged input.
#![expect(clippy::unwrap_used, clippy::panic, reason = "a fixture that does not parse fails the test")]

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use atsplat_pixels::{DecodeLimits, Orientation, PixelError, decode, encode_jpeg, size_of};
use sha2::{Digest, Sha256};

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

/// What Pillow wrote into the one file that has it; the pixels stay as they are stored.
#[test]
fn an_orientation_is_told_and_not_applied() {
    let told = |name: &str| Orientation::of(&std::fs::read(folder().join(name)).unwrap());
    assert_eq!(told("exif_orientation_is_ignored.jpg"), Some(Orientation::Clockwise));
    let others = golden().into_iter().filter(|(name, _, _)| !name.starts_with("exif"));
    assert!(others.into_iter().all(|(name, _, _)| told(&name).is_none()));
}

/// The scene that `make_pictures.py` saved is in `lossless.webp` too, so it can be saved here.
#[test]
fn jpegs_are_written_with_pillows_bits() {
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
