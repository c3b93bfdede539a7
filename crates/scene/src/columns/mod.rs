//! Camera tables: one row per frame, typed and documented columns, lossless in f64.
//!
//! [`CameraTable`] collects frames into Arrow record batches of bounded size. [`schema()`] describes every column and states the
//! convention of the poses in its metadata, so that a file documents itself.

mod error;
mod schema;
mod table;

pub use error::ColumnsError;
pub(crate) use schema::metadata;
pub use schema::{CONVENTION, SCHEMA_VERSION, schema};
pub use table::CameraTable;

#[cfg(test)]
pub(crate) mod tests;
