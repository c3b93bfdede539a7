use arrow_schema::{ArrowError, DataType};
use atsplat_camera::CameraError;
use thiserror::Error;

/// Why scenes do not make columns, or columns no cameras.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum ColumnsError {
    /// One frame's texts alone are longer than a record batch may be.
    #[error("frame {frame} of scene {scene}: expected at most {limit} bytes of text, found {found}")]
    RowTooLong {
        /// Scene key, shortened.
        scene: String,
        /// Position of the frame in the scene.
        frame: usize,
        /// [`super::CameraTable::TEXT_LIMIT`].
        limit: usize,
        /// Bytes of key, address, name and path.
        found: usize,
    },
    /// The batch was written under another version of the schema.
    #[error("camera table: expected schema version {expected}, found {found:?}")]
    Version {
        /// [`super::SCHEMA_VERSION`].
        expected: &'static str,
        /// What the batch says.
        found: String,
    },
    /// A column is not there.
    #[error("camera table: expected a column {column:?}, found none")]
    MissingColumn {
        /// The column's name.
        column: &'static str,
    },
    /// A column has another type.
    #[error("camera table: column {column:?}: expected {expected}, found {found}")]
    WrongType {
        /// The column's name.
        column: &'static str,
        /// The schema's type.
        expected: &'static str,
        /// The batch's type.
        found: DataType,
    },
    /// A cell is empty that must not be.
    #[error("camera table: row {row}, column {column:?}: expected a value, found null")]
    Null {
        /// The column's name.
        column: &'static str,
        /// Row in the batch, from 0.
        row: usize,
    },
    /// A cell holds a word that the schema does not know.
    #[error("camera table: row {row}, column {column:?}: expected {expected}, found {found:?}")]
    UnknownWord {
        /// The column's name.
        column: &'static str,
        /// Row in the batch, from 0.
        row: usize,
        /// The words that the schema knows.
        expected: &'static str,
        /// What stands there.
        found: String,
    },
    /// A row's numbers are no camera.
    #[error("camera table: row {row}: {source}")]
    Camera {
        /// Row in the batch, from 0.
        row: usize,
        /// What is wrong with the numbers.
        source: CameraError,
    },
    /// Arrow refused.
    #[error(transparent)]
    Arrow(#[from] ArrowError),
}
