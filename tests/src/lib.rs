//! Finds the real data that some cross-crate tests run on.

use std::io::Write;
use std::path::{Path, PathBuf};

/// The folder of real data: `$ATSPLAT_SHARED_DATA`, or `../shared/data` beside the checkout.
///
/// `None`, with a visible line, where there is none: the calling test returns. With
/// `ATSPLAT_REQUIRE_SHARED_DATA` set, absence is a failure instead, so that a machine that has the data
/// cannot skip in silence.
///
/// # Panics
/// When the data is required and absent.
pub fn shared_data(test: &str) -> Option<PathBuf> {
    let beside = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../shared/data");
    let folder = std::env::var_os("ATSPLAT_SHARED_DATA").map_or(beside, PathBuf::from);
    if folder.is_dir() {
        return Some(folder);
    }
    let required = std::env::var_os("ATSPLAT_REQUIRE_SHARED_DATA").is_some();
    assert!(!required, "{test}: real data is required but absent ({})", folder.display());
    skip(test, &folder);
    None
}

/// Written past the test harness's capture: a skipped test must be seen.
fn skip(test: &str, folder: &Path) {
    let line = format!("SKIPPED {test}: no real data ({})\n", folder.display());
    std::io::stderr().write_all(line.as_bytes()).ok();
}
