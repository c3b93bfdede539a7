//! Prints results on standard output; status, warnings and errors on standard error. Copies of objects are named by their URLs.

use std::fmt::Display;
use std::io::{ErrorKind, Write as _};

use anyhow::Context as _;
use serde::Serialize;

use crate::objects::with_urls;

/// Prints a report on standard output, as text or as JSON.
pub(crate) fn print_report<R: Display + Serialize>(report: &R, json: bool) -> anyhow::Result<()> {
    if json { print_json(report) } else { print_text(&report.to_string()) }
}

/// Prints JSON on standard output.
pub(crate) fn print_json<T: Serialize + ?Sized>(value: &T) -> anyhow::Result<()> {
    print_text(&format!("{}\n", serde_json::to_string_pretty(value)?))
}

/// Prints text on standard output; a closed pipe is not an error.
pub(crate) fn print_text(text: &str) -> anyhow::Result<()> {
    let (text, mut stdout) = (with_urls(text), std::io::stdout().lock());
    match stdout.write_all(text.as_bytes()).and_then(|()| stdout.flush()) {
        Err(error) if error.kind() == ErrorKind::BrokenPipe => Ok(()),
        outcome => outcome.context("writing to standard output"),
    }
}

/// Prints a line on standard error.
pub(crate) fn print_status(line: &str) {
    writeln!(std::io::stderr(), "{}", with_urls(line)).ok();
}

/// Prints a warning: something may be wrong.
pub(crate) fn warn(message: &str) {
    print_status(&format!("warning: {message}"));
}

/// Prints a note: something that is worth knowing, but not wrong.
pub(crate) fn note(message: &str) {
    print_status(&format!("note: {message}"));
}
