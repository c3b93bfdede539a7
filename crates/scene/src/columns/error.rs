use arrow_schema::{ArrowError, DataType};
use atsplat_camera::CameraError;
use thiserror::Error;

/// Why scenes cannot be converted to a camera table, or a table to cameras.
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
    /// The batch was written under another version of the schema.
    #[error("camera table: expected schema version {expected}, found {found:?}")]
    Version {
        /// [`super::SCHEMA_VERSION`].
        expected: &'static str,
        found: String,
    },
    /// A column is missing.
    #[error("camera table: expected a column {column:?}, found none")]
    MissingColumn { column: &'static str },
    /// A column has another type.
    #[error("camera table: column {column:?}: expected {expected}, found {found}")]
    WrongType { column: &'static str, expected: &'static str, found: DataType },
    /// A required cell is null.
    #[error("camera table: row {row}, column {column:?}: expected a value, found null")]
    Null {
        column: &'static str,
        /// Row in the batch, from 0.
        row: usize,
    },
    /// A cell of an enumerated column holds an unknown value.
    #[error("camera table: row {row}, column {column:?}: expected {expected}, found {found:?}")]
    UnknownValue {
        column: &'static str,
        /// Row in the batch, from 0.
        row: usize,
        expected: &'static str,
        /// The cell's value, shortened.
        found: String,
    },
    /// A row's numbers are not a valid camera.
    #[error("camera table: row {row}: {source}")]
    Camera {
        /// Row in the batch, from 0.
        row: usize,
        source: CameraError,
    },
    /// Arrow returned an error.
    #[error(transparent)]
    Arrow(#[from] ArrowError),
}
