//! Synthetic images for tests.

use atsplat_numeric::{SPLIT_MIX_STEP, split_mix, unit_of_bits};
use atsplat_pixels::ImageU8;
use glam::DVec2;

/// Gaussian blobs of several sizes at known sub-pixel centres (pixel centres at + 0.5).
pub(crate) fn blobs(width: u32, height: u32) -> (ImageU8, Vec<DVec2>) {
    let mut centres = Vec::new();
    for row in 0..height / 40 {
        for column in 0..width / 40 {
            let wiggle = f64::from((row * 7 + column * 3) % 10) * 0.1;
            centres.push(DVec2::new(f64::from(column) * 40.0 + 20.0 + wiggle, f64::from(row) * 40.0 + 20.7 - wiggle));
        }
    }
    let value = |x: u32, y: u32| {
        let pixel = DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5);
        let light: f64 = centres
            .iter()
            .enumerate()
            .map(|(index, centre)| {
                let sigma = 2.5 + (index % 4) as f64;
                (-0.5 * pixel.distance_squared(*centre) / (sigma * sigma)).exp()
            })
            .sum();
        40.0 + 180.0 * light
    };
    (image(width, height, value), centres)
}

/// Smooth noise: the window of an infinite texture that starts at (`column`, `row`).
pub(crate) fn shifted_noise(width: u32, height: u32, column: i32, row: i32) -> ImageU8 {
    let value = |x: u32, y: u32| {
        let (x, y) = (f64::from(x) + f64::from(column), f64::from(y) + f64::from(row));
        [(5.0, 60.0), (9.0, 90.0), (21.0, 70.0)].iter().map(|(cell, gain)| gain * noise(x / cell, y / cell)).sum()
    };
    image(width, height, value)
}

fn image(width: u32, height: u32, value: impl Fn(u32, u32) -> f64) -> ImageU8 {
    let mut samples = Vec::new();
    for y in 0..height {
        for x in 0..width {
            let level = level(value(x, y));
            samples.extend([level; 3]);
        }
    }
    ImageU8::new(width, height, samples).unwrap()
}

/// Value noise in [0, 1] with smooth steps between hashed lattice points.
pub(crate) fn noise(x: f64, y: f64) -> f64 {
    let (x0, y0) = (x.floor(), y.floor());
    let ease = |t: f64| t * t * (3.0 - 2.0 * t);
    let (u, v) = (ease(x - x0), ease(y - y0));
    let at = |dx: f64, dy: f64| lattice(x0 + dx, y0 + dy);
    let top = at(0.0, 0.0) * (1.0 - u) + at(1.0, 0.0) * u;
    let bottom = at(0.0, 1.0) * (1.0 - u) + at(1.0, 1.0) * u;
    top * (1.0 - v) + bottom * v
}

/// A hash of both coordinates in [0, 1).
fn lattice(x: f64, y: f64) -> f64 {
    let state = x.to_bits().wrapping_mul(SPLIT_MIX_STEP) ^ y.to_bits().wrapping_mul(0xbf58_476d_1ce4_e5b9);
    unit_of_bits(split_mix(state))
}

/// Rounds and clamps to a sample value.
#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "rounded and clamped to 0..=255")]
pub(crate) fn level(value: f64) -> u8 {
    value.round().clamp(0.0, 255.0) as u8
}
