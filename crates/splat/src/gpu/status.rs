use super::GpuError;
use crate::GaussianCounts;

/// Words of the buffer.
const WORDS: usize = 8;
/// Its bytes.
pub(super) const BYTES: u64 = 4 * WORDS as u64;

/// What the device reports about a rendering; see `needs.wgsl`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Status {
    pub(super) counts: GaussianCounts,
    /// Whether lists were too short, so that the results are incomplete.
    pub(super) is_incomplete: bool,
    /// Most pairs of a window, and of a tile.
    pub(super) pairs: u64,
    pub(super) longest: u64,
}

impl Status {
    pub(super) fn parse(adapter: &str, bytes: &[u8]) -> Result<Self, GpuError> {
        let words: Vec<u64> = bytes.as_chunks().0.iter().map(|word| u32::from_le_bytes(*word).into()).collect();
        let [drawn, invalid, outside_depth, faint, outside_image, incomplete, pairs, longest] = *words else {
            let reason = format!("status: expected {BYTES} bytes, found {}", bytes.len());
            return Err(GpuError::Device { adapter: adapter.to_owned(), reason });
        };
        let counts = GaussianCounts { drawn, invalid, outside_depth, faint, outside_image };
        Ok(Self { counts, is_incomplete: incomplete != 0, pairs, longest })
    }
}
