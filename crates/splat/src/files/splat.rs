//! antimatter15's `.splat`: rows of 32 bytes without a header.
//!
//! A row is centre (3 × f32), standard deviations (3 × f32), colour and opacity (4 × u8 over 255), quaternion
//! (w, x, y, z as u8, 128 for zero and 128 for one), little-endian (antimatter15/splat `main.js`).

use super::quantised::{dc, logit};
use super::{Fault, Format, Stored};
use crate::GaussianParts;

const ROW: usize = 32;

pub(super) fn read(bytes: &[u8]) -> Result<Stored, Fault> {
    let (rows, []) = bytes.as_chunks::<ROW>() else {
        let found = format!("{} bytes", bytes.len());
        return Err(Fault::new("file size", format!("a multiple of {ROW} bytes"), found));
    };
    let mut parts = GaussianParts::default();
    for row in rows {
        let (floats, bytes) = row.split_at(24);
        let mut floats = floats.as_chunks::<4>().0.iter().map(|float| f32::from_le_bytes(*float));
        let mut three = || [(); 3].map(|()| floats.next().unwrap_or(f32::NAN));
        parts.means.push(three());
        parts.log_scales.push(three().map(f32::ln));
        if let [r, g, b, opacity, quaternion @ ..] = bytes {
            parts.sh.push([*r, *g, *b].map(|byte| dc(f64::from(byte) / 255.0)));
            parts.opacity_logits.push(logit(f64::from(*opacity) / 255.0));
            let part = |at: usize| (f32::from(quaternion.get(at).copied().unwrap_or(128)) - 128.0) / 128.0;
            parts.quaternions.push([part(0), part(1), part(2), part(3)]);
        }
    }
    Ok(Stored { parts, format: Format::Splat, unused: Vec::new(), antialiased: None })
}
