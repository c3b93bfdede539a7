//! Unit quaternions (x, y, z, w here, as the format has them) in 3 or 4 bytes.

use std::f64::consts::FRAC_1_SQRT_2;

/// Largest magnitude in nine bits, which stands for √½: no part but the largest exceeds that.
const LARGEST: u32 = (1 << 9) - 1;

/// Versions 1 and 2: x, y and z over [−1, 1] in a byte each; w is what is left.
pub(super) fn from_three_bytes(bytes: [u8; 3]) -> [f64; 4] {
    let [x, y, z] = bytes.map(|byte| f64::from(byte) / 127.5 - 1.0);
    [x, y, z, what_is_left([x, y, z])]
}

/// Of a unit quaternion.
pub(super) fn to_three_bytes([x, y, z, w]: [f64; 4]) -> [u8; 3] {
    let sign = if w < 0.0 { -1.0 } else { 1.0 };
    [x, y, z].map(|part| super::encode::byte(sign * part * 127.5 + 127.5))
}

/// Versions 3 and 4: the position of the largest part in the two highest bits, then a sign and nine bits of
/// magnitude for each of the others.
pub(super) fn from_four_bytes(bytes: [u8; 4]) -> [f64; 4] {
    let packed = u32::from_le_bytes(bytes);
    let part = |shift: u32| {
        let magnitude = f64::from((packed >> shift) & LARGEST) / f64::from(LARGEST) * FRAC_1_SQRT_2;
        if (packed >> (shift + 9)) & 1 == 1 { -magnitude } else { magnitude }
    };
    let [a, b, c] = [20, 10, 0].map(part);
    let largest = what_is_left([a, b, c]);
    match packed >> 30 {
        0 => [largest, a, b, c],
        1 => [a, largest, b, c],
        2 => [a, b, largest, c],
        _ => [a, b, c, largest],
    }
}

/// Of a unit quaternion.
pub(super) fn to_four_bytes(quaternion: [f64; 4]) -> [u8; 4] {
    let mut largest = (0, 0.0f64);
    for (at, part) in (0u32..).zip(quaternion) {
        if part.abs() > largest.1.abs() {
            largest = (at, part);
        }
    }
    let mut packed = largest.0;
    for (at, part) in (0u32..).zip(quaternion) {
        if at != largest.0 {
            let negative = u32::from((part < 0.0) != (largest.1 < 0.0));
            #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped to nine bits")]
            let magnitude = (part.abs() / FRAC_1_SQRT_2 * f64::from(LARGEST) + 0.5) as u32;
            packed = packed << 10 | negative << 9 | magnitude.min(LARGEST);
        }
    }
    packed.to_le_bytes()
}

/// The part of a unit quaternion that is not stored; ≥ 0.
fn what_is_left(others: [f64; 3]) -> f64 {
    let left = 1.0 - others.iter().map(|part| part * part).sum::<f64>();
    if left > 0.0 { left.sqrt() } else { 0.0 }
}
