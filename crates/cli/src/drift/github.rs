//! `atsplat drift --github`: an annotation, and Markdown in the summary of a step.

use std::ffi::OsStr;
use std::fs::OpenOptions;
use std::io::Write as _;
use std::path::Path;

use atsplat_drift::DriftReport;

use crate::print::{print_status, warn};

/// Prints the annotation on standard error, where GitHub reads it as well, and adds to the summary. A summary that cannot be written
/// is a warning, because it must not hide the drift.
pub(super) fn tell(report: &DriftReport, baseline: &Path) {
    if let Some(annotation) = report.annotation(&baseline.display().to_string()) {
        print_status(&annotation);
    }
    let Some(summary) = std::env::var_os("GITHUB_STEP_SUMMARY").filter(|path| !path.is_empty()) else { return };
    if let Err(error) = add(&summary, &report.markdown()) {
        warn(&format!("--github: the summary of the step: {error} ({})", Path::new(&summary).display()));
    }
}

/// Other commands of the step write to the same file.
fn add(path: &OsStr, text: &str) -> std::io::Result<()> {
    OpenOptions::new().create(true).append(true).open(path)?.write_all(text.as_bytes())
}
