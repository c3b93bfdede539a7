use arrow_schema::ArrowError;
use thiserror::Error;

/// Why scenes cannot be converted to a camera table.
#[derive(Debug, Error)]
#[non_exhaustive]
#[expect(missing_docs, reason = "the message explains the fields")]
pub enum ColumnsError {
    /// One frame's text alone exceeds the limit of a record batch.
    #[error("frame {frame} of scene {scene}: expected at most {limit} bytes of text, found {found}")]
    RowTooLong {
        /// Scene key, shortened.
        scene: String,
        frame: usize,
        /// [`super::CameraTable::TEXT_LIMIT`].
        limit: usize,
        /// Bytes of key, URL, name and path.
        found: usize,
    },
    /// Arrow returned an error.
    #[error(transparent)]
    Arrow(#[from] ArrowError),
}
