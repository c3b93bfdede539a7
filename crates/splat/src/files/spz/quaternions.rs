//! Unit quaternions in 3 or 4 bytes; in the format's order x, y, z, w.

use std::f64::consts::FRAC_1_SQRT_2;

use crate::files::{missing_component, with_largest_component};

/// Largest nine-bit magnitude; it represents √½, which no component but the largest exceeds.
const LARGEST: u32 = (1 << 9) - 1;

/// Versions 1 and 2: x, y and z over [−1, 1] in a byte each; w follows from the unit norm.
pub(super) fn from_three_bytes(bytes: [u8; 3]) -> [f64; 4] {
    let [x, y, z] = bytes.map(|byte| f64::from(byte) / 127.5 - 1.0);
    [x, y, z, missing_component([x, y, z])]
}

/// Encodes a unit quaternion.
pub(super) fn to_three_bytes([x, y, z, w]: [f64; 4]) -> [u8; 3] {
    let sign = if w < 0.0 { -1.0 } else { 1.0 };
    [x, y, z].map(|component| super::encode::byte(sign * component * 127.5 + 127.5))
}

/// Versions 3 and 4: the index of the largest component in the two highest bits, then a sign and nine bits of magnitude
/// for each of the others.
pub(super) fn from_four_bytes(bytes: [u8; 4]) -> [f64; 4] {
    let packed = u32::from_le_bytes(bytes);
    let component = |shift: u32| {
        let magnitude = f64::from((packed >> shift) & LARGEST) / f64::from(LARGEST) * FRAC_1_SQRT_2;
        if (packed >> (shift + 9)) & 1 == 1 { -magnitude } else { magnitude }
    };
    with_largest_component(packed >> 30, [20, 10, 0].map(component))
}

/// Encodes a unit quaternion.
pub(super) fn to_four_bytes(quaternion: [f64; 4]) -> [u8; 4] {
    let mut largest = (0, 0.0f64);
    for (at, component) in (0u32..).zip(quaternion) {
        if component.abs() > largest.1.abs() {
            largest = (at, component);
        }
    }
    let mut packed = largest.0;
    for (at, component) in (0u32..).zip(quaternion) {
        if at != largest.0 {
            let negative = u32::from((component < 0.0) != (largest.1 < 0.0));
            #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped to nine bits")]
            let magnitude = (component.abs() / FRAC_1_SQRT_2 * f64::from(LARGEST) + 0.5) as u32;
            packed = packed << 10 | negative << 9 | magnitude.min(LARGEST);
        }
    }
    packed.to_le_bytes()
}
