//! antimatter15's `.splat`: rows of 32 bytes without a header.
//!
//! A row is centre (3 × f32), standard deviations (3 × f32), colour and opacity (4 × u8 over 255), quaternion (w, x, y,
//! z as u8, 128 for zero and a further 128 for one), little-endian (antimatter15/splat `main.js`).

use super::{Format, Malformed, Stored, dc, finite_logit};
use crate::GaussianParts;

const ROW: usize = 32;

pub(super) fn read(bytes: &[u8]) -> Result<Stored, Malformed> {
    let (rows, []) = bytes.as_chunks::<ROW>() else {
        let found = format!("{} bytes", bytes.len());
        return Err(Malformed::new("file size", format!("a multiple of {ROW} bytes"), found));
    };
    let mut parts = GaussianParts::default();
    for row in rows {
        let ([x, y, z, s0, s1, s2, [r, g, b, opacity], quaternion], []) = row.as_chunks::<4>() else {
            unreachable!("a row is 8 × 4 bytes")
        };
        parts.means.push([x, y, z].map(|bytes| f32::from_le_bytes(*bytes)));
        parts.log_scales.push([s0, s1, s2].map(|bytes| f32::from_le_bytes(*bytes).ln()));
        parts.sh.push([*r, *g, *b].map(|byte| dc(f64::from(byte) / 255.0)));
        parts.opacity_logits.push(finite_logit(f64::from(*opacity) / 255.0));
        parts.quaternions.push(quaternion.map(|byte| (f32::from(byte) - 128.0) / 128.0));
    }
    Ok(Stored { parts, format: Format::Splat, unused: Vec::new(), integers: Vec::new(), antialiased: None })
}
