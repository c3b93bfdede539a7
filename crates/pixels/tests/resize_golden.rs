//! Resizing compared with Pillow (`fixtures/make_resize_golden.py`).

#![expect(clippy::unwrap_used, clippy::panic, reason = "an invalid fixture fails the test")]

use std::path::{Path, PathBuf};

use atsplat_files::Sha256Digest;
use atsplat_numeric::{SPLIT_MIX_STEP, split_mix};
use atsplat_pixels::{Filter, ImageU8, resize};

#[test]
fn resizing_matches_pillow_bit_for_bit() {
    let cases = check(&Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/fixtures/resize_golden.csv"));
    assert!(cases > 200, "the fixture has only {cases} cases");
    if let Some(more) = std::env::var_os("ATSPLAT_RESIZE_GOLDEN") {
        println!("{} additional cases", check(&PathBuf::from(more)));
    }
}

/// Checks every line of a file and returns their number.
fn check(path: &Path) -> usize {
    let text = std::fs::read_to_string(path).unwrap();
    let mut wrong = Vec::new();
    let mut cases = 0;
    for line in text.lines().filter(|line| !line.starts_with('#')) {
        let fields: Vec<&str> = line.split(',').collect();
        let [pattern, seed, width, height, to_width, to_height, filter, expected] = fields[..] else {
            panic!("{}: {line}", path.display());
        };
        let number = |text: &str| text.parse::<u32>().unwrap();
        let source = image(pattern, number(seed), number(width), number(height));
        let filter = match filter {
            "lanczos" => Filter::Lanczos,
            "bilinear" => Filter::Bilinear,
            "box" => Filter::Box,
            other => panic!("{other}"),
        };
        let resized = resize(&source, number(to_width), number(to_height), filter).unwrap();
        if Sha256Digest::of(resized.samples()) != expected.parse().unwrap() {
            wrong.push(line.to_owned());
        }
        cases += 1;
    }
    assert!(wrong.is_empty(), "{} of {cases} differ from Pillow:\n{}", wrong.len(), wrong.join("\n"));
    cases
}

fn image(pattern: &str, seed: u32, width: u32, height: u32) -> ImageU8 {
    let state = |index: u64| (index + (u64::from(seed) << 32)).wrapping_add(1).wrapping_mul(SPLIT_MIX_STEP);
    let noise = |index: u64| split_mix(state(index)).to_be_bytes()[0];
    let count = u64::from(width) * u64::from(height) * 3;
    let samples = match pattern {
        "noise" => (0..count).map(noise).collect(),
        "binary" => (0..count).map(|index| if noise(index) < 128 { 0 } else { 255 }).collect(),
        "gradient" => {
            painted(width, height, |column, row, channel| column * (seed % 5 + 1) + row * (seed % 3 + 1) + channel * 85)
        }
        "checker" => {
            let cell = seed % 7 + 1;
            painted(width, height, |column, row, channel| ((column / cell + row / cell + channel) & 1) * 255)
        }
        other => panic!("{other}"),
    };
    ImageU8::new(width, height, samples).unwrap()
}

fn painted(width: u32, height: u32, paint: impl Fn(u32, u32, u32) -> u32) -> Vec<u8> {
    let positions =
        (0..height).flat_map(|row| (0..width).flat_map(move |column| (0..3).map(move |c| (column, row, c))));
    positions.map(|(column, row, channel)| paint(column, row, channel).to_le_bytes()[0]).collect()
}
