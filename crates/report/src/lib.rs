//! Reports: tables, plots and one HTML page from results stores. This crate only presents numbers; it computes none.
//!
//! A [`definition::TableDefinition`] describes a table of the paper; [`table::tables`] fills it from stores, with measured
//! rows below the published rows they reproduce; [`emit::TableFormat`] writes it. [`plot`] turns plain data into drawings,
//! and [`Report`] writes everything into a folder with one self-contained page.

#![expect(
    clippy::format_push_string,
    clippy::format_collect,
    reason = "tables and pages are built as text piece by piece, in proportion to their content"
)]

mod csv_text;
pub mod definition;
pub mod emit;
mod error;
pub mod figures;
mod file_names;
#[cfg(test)]
mod gallery;
pub mod page;
pub mod plot;
mod report;
#[cfg(test)]
mod sample;
pub mod table;
mod written;

pub use error::ReportError;
pub use report::{Report, Request, store_labels};
pub use written::Written;

/// A number of things, each of which is a `what`: `1 scene`, `2 scenes`, `3 entries`.
pub fn counted(count: u64, what: &str) -> String {
    format!("{count} {}", noun(count, what))
}

/// The word for so many of a `what`: `scene`, `scenes`, `entries`.
fn noun(count: u64, what: &str) -> String {
    match what.strip_suffix("ry") {
        _ if count == 1 => what.to_owned(),
        Some(stem) => format!("{stem}ries"),
        None => format!("{what}s"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn counts_have_the_plural_of_their_noun() {
        assert_eq!([0, 1, 2].map(|count| counted(count, "scene")), ["0 scenes", "1 scene", "2 scenes"]);
        assert_eq!([0, 1, 2].map(|count| counted(count, "entry")), ["0 entries", "1 entry", "2 entries"]);
    }
}
