//! What tests need that a machine may lack: real data, a graphics adapter. A test that skips says so where it is seen,
//! and appends a line to the file `$ATSPLAT_SKIP_LOG`, from which CI lists every skipped test at its end.

use std::fmt::Display;
use std::fs::OpenOptions;
use std::io::Write as _;
use std::path::{Path, PathBuf};

/// The folder of real data: `$ATSPLAT_SHARED_DATA`, or `../shared/data` beside the checkout. Where there is none the test
/// is skipped and returns.
///
/// # Panics
/// Where there is none although `ATSPLAT_REQUIRE_SHARED_DATA` is set.
pub fn shared_data(test: &str) -> Option<PathBuf> {
    let beside = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../shared/data");
    let folder = std::env::var_os("ATSPLAT_SHARED_DATA").map_or(beside, PathBuf::from);
    if folder.is_dir() {
        return Some(folder);
    }
    let required = std::env::var_os("ATSPLAT_REQUIRE_SHARED_DATA").is_some();
    assert!(!required, "{test}: real data is required but absent ({})", folder.display());
    skip(test, format!("no real data ({})", folder.display()));
    None
}

/// Whether `ATSPLAT_REQUIRE_GPU=1`: no test may be skipped for want of a graphics adapter.
pub fn graphics_required() -> bool {
    std::env::var("ATSPLAT_REQUIRE_GPU").as_deref() == Ok("1")
}

/// Skips a test because no graphics adapter could be opened.
///
/// # Panics
/// Where one is required ([`graphics_required`]).
pub fn skip_without_graphics(test: &str, error: impl Display) {
    assert!(!graphics_required(), "{test}: a graphics adapter is required: {error}");
    skip(test, format!("no graphics adapter: {error}"));
}

/// Says that a test is skipped and why, past the test harness's capture.
///
/// # Panics
/// Where `$ATSPLAT_SKIP_LOG` cannot be written: a skip that nobody sees is a fault.
pub fn skip(test: &str, reason: impl Display) {
    let line = format!("SKIPPED {test}: {}\n", reason.to_string().replace('\n', " "));
    // Without standard error there is still the log.
    std::io::stderr().write_all(line.as_bytes()).ok();
    let Some(log) = std::env::var_os("ATSPLAT_SKIP_LOG").map(PathBuf::from) else { return };
    let file = OpenOptions::new().append(true).create(true).open(&log);
    let written = file.and_then(|mut file| file.write_all(line.as_bytes()));
    assert!(written.is_ok(), "{test}: the skip cannot be recorded in {}: {written:?}", log.display());
}
