//! Reports: tables, plots and one HTML page from results stores. Means, intervals, slopes and paired differences are those of
//! [`atsplat_results::statistics`]. Computed here are which numbers compare, ranks, the agreement with published numbers, mean sizes over
//! several trainings, the mean PSNR of context views, histograms, and the error maps of single trials.
//!
//! A [`definition::TableDefinition`] describes a table of the paper; [`table::tables`] fills it from stores, with measured
//! rows below the published rows they reproduce; [`emit::TableFormat`] writes it. [`plot`] turns plain data into drawings,
//! and [`Report`] writes everything into a folder with one self-contained page.

#![expect(
    clippy::format_push_string,
    clippy::format_collect,
    reason = "tables and pages are built as text piece by piece, in proportion to their content"
)]

pub mod definition;
pub mod emit;
mod error;
mod file_list;
mod file_names;
#[cfg(test)]
mod gallery;
mod hashes;
mod numbers;
pub mod page;
pub mod plot;
pub mod plot_data;
mod report;
#[cfg(test)]
mod sample;
pub mod table;

pub use atsplat_numeric::counted;
pub use error::ReportError;
pub use file_list::Written;
pub use report::{PAGE_MEGABYTES, Report, Request, store_labels};
