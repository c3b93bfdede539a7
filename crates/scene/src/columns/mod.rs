//! Trajectories as columns: one row per frame, typed and documented, lossless in f64.
//!
//! [`CameraTable`] gathers frames into Arrow record batches of bounded size, [`rows_from_batch`] gives the
//! cameras back bit for bit. [`schema()`] describes every column and carries the convention in its metadata,
//! so that a file says by itself which way its poses go.

mod error;
mod read;
mod schema;
mod table;

pub use error::ColumnsError;
pub use read::{CameraRow, rows_from_batch};
pub(crate) use schema::metadata;
pub use schema::{CONVENTION, SCHEMA_VERSION, schema};
pub use table::{CameraTable, batches_from_scene};

#[cfg(test)]
mod tests;
