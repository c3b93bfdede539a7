//! A results store into tables, plots and one HTML page. How a number was made is not known here.

mod error;
pub mod gallery;
pub mod plot;

pub use error::ReportError;
