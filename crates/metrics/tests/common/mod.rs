//! Seeded images and numbers, equal to those of `oracle/seeded.py`.

#![allow(dead_code, reason = "each test file uses a part")]
#![expect(clippy::unwrap_used, reason = "a fixture that does not parse fails the test")]

use std::path::Path;

use atsplat_numeric::{SPLIT_MIX_STEP, split_mix, unit_of_bits};
use atsplat_pixels::{DecodeLimits, Image, decode};

pub(crate) fn fixture(name: &str) -> serde_json::Value {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/fixtures").join(name);
    serde_json::from_str(&std::fs::read_to_string(path).unwrap()).unwrap()
}

/// A case's image, cropped to its box of left, top, width, height.
pub(crate) fn truth(case: &serde_json::Value) -> Image {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../pixels/tests/fixtures/images");
    let bytes = std::fs::read(folder.join(case["image"].as_str().unwrap())).unwrap();
    let image = Image::from_u8(&decode(&bytes, &DecodeLimits::default()).unwrap());
    match case["box"].as_array() {
        Some(sides) => {
            let sides: Vec<u32> = sides.iter().map(|side| u32::try_from(side.as_u64().unwrap()).unwrap()).collect();
            crop(&image, [sides[0], sides[1], sides[2], sides[3]])
        }
        None => image,
    }
}

/// Crops a rectangle of left, top, width, height.
pub(crate) fn crop(image: &Image, [left, top, width, height]: [u32; 4]) -> Image {
    let rows = (top..top + height).flat_map(|y| (left..left + width).map(move |x| (x, y)));
    Image::new(width, height, rows.flat_map(|(x, y)| image.pixel(x, y).unwrap()).collect()).unwrap()
}

/// `seeded.render`.
pub(crate) fn render(truth: &Image, seed: u64) -> Image {
    let (width, samples) = (truth.width() as usize, truth.samples());
    let noise = uniform(seed, samples.len(), 0.08);
    let rendered = (0..samples.len()).map(|sample| {
        let (pixel, channel) = (sample / 3, sample % 3);
        let left = if pixel % width == 0 { pixel + width - 1 } else { pixel - 1 };
        0.75 * samples[sample] + 0.3 * samples[left * 3 + channel] + noise[sample]
    });
    Image::new(truth.width(), truth.height(), rendered.collect()).unwrap()
}

/// `seeded.uniform`.
pub(crate) fn uniform(seed: u64, count: usize, bound: f64) -> Vec<f32> {
    #[expect(clippy::cast_possible_truncation, reason = "samples are f32")]
    let number = |position: u64| {
        let bits = split_mix(seed.wrapping_add(position + 1).wrapping_mul(SPLIT_MIX_STEP));
        ((2.0 * unit_of_bits(bits) - 1.0) * bound) as f32
    };
    (0..count as u64).map(number).collect()
}

/// An image of seeded samples in [0, 1].
pub(crate) fn seeded(width: u32, height: u32, seed: u64) -> Image {
    let samples = uniform(seed, (width * height * 3) as usize, 0.5).into_iter().map(|v| v + 0.5).collect();
    Image::new(width, height, samples).unwrap()
}
