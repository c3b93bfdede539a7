use super::coefficients::{Coefficients, PRECISION_BITS};
use crate::PixelError;
use crate::memory::reserved;

const HALF: i32 = 1 << (PRECISION_BITS - 1);

/// Every row by itself: `source` of `width` columns into `columns.len()` columns.
pub(super) fn horizontal(source: &[u8], width: u32, columns: &Coefficients) -> Result<Vec<u8>, PixelError> {
    let stride = width as usize * 3;
    let rows = source.len() / stride;
    let mut target = reserved("resized picture", columns.len() as u64, rows as u64, 3)?;
    for row in source.chunks_exact(stride) {
        for (start, weights) in columns.iter() {
            let mut sums = [HALF; 3];
            let pixels = row.get(start * 3..).unwrap_or_default().as_chunks::<3>().0;
            for (pixel, &weight) in pixels.iter().zip(weights) {
                for (sum, &sample) in sums.iter_mut().zip(pixel) {
                    *sum = sum.wrapping_add(i32::from(sample).wrapping_mul(weight));
                }
            }
            target.extend(sums.map(clipped));
        }
    }
    Ok(target)
}

/// Every column by itself: rows of `width` pixels into `rows.len()` rows.
pub(super) fn vertical(source: &[u8], width: u32, rows: &Coefficients) -> Result<Vec<u8>, PixelError> {
    let stride = width as usize * 3;
    let mut target = reserved("resized picture", width.into(), rows.len() as u64, 3)?;
    let mut sums = vec![0; stride];
    for (start, weights) in rows.iter() {
        sums.fill(HALF);
        let seen = source.chunks_exact(stride).skip(start);
        for (row, &weight) in seen.zip(weights) {
            for (sum, &sample) in sums.iter_mut().zip(row) {
                *sum = sum.wrapping_add(i32::from(sample).wrapping_mul(weight));
            }
        }
        target.extend(sums.iter().copied().map(clipped));
    }
    Ok(target)
}

#[expect(clippy::cast_sign_loss, reason = "clamped to a byte")]
fn clipped(sum: i32) -> u8 {
    (sum >> PRECISION_BITS).clamp(0, 255) as u8
}
