//! A results store into tables, plots and one HTML page. How a number was made is not known here.
//!
//! A [`definition::TableDefinition`] says what a table of the paper shows; [`table::tables`] fills it from stores, published
//! rows first and what was measured below each; [`emit::TableFormat`] writes it. [`plot`] turns plain data into drawings, and
//! [`Report`] puts everything into a folder with one page that needs no other file.

#![expect(
    clippy::format_push_string,
    clippy::format_collect,
    reason = "tables and pages are text that grows piece by piece; their size is that of what they show"
)]

mod csv_text;
pub mod definition;
pub mod emit;
mod error;
pub mod figures;
pub mod gallery;
pub mod page;
pub mod plot;
mod report;
#[cfg(test)]
mod sample;
pub mod table;

pub use error::ReportError;
pub use report::{Report, Request};
