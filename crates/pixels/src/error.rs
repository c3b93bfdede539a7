use thiserror::Error;

/// Why bytes do not make a picture, or a picture cannot be changed as asked.
#[derive(Debug, Error)]
pub enum PixelError {
    /// The number of samples does not match the size.
    #[error("{width}×{height} RGB needs {expected} samples, found {found}")]
    SampleCount {
        /// Columns.
        width: u32,
        /// Rows.
        height: u32,
        /// `width · height · 3`.
        expected: u64,
        /// What was given.
        found: usize,
    },
}
