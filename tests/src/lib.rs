//! What the tests of several crates need: threads, files in folders, and what a machine may lack, such as real data, a graphics
//! adapter or a browser. A test that skips says so where it is seen, and appends a line to the file `$ATSPLAT_SKIP_LOG`, from which CI
//! lists every skipped test at its end.

use std::ffi::OsString;
use std::fmt::Display;
use std::fs::OpenOptions;
use std::io::Write as _;
use std::path::{Path, PathBuf};

/// Runs `work` in a pool of this many threads.
///
/// # Panics
/// Where the system gives no threads.
pub fn on_threads<T: Send>(threads: usize, work: impl FnOnce() -> T + Send) -> T {
    #[expect(clippy::expect_used, reason = "a test fails by panicking")]
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads of the system");
    pool.install(work)
}

/// Writes a file, and the folders that it is in.
///
/// # Panics
/// Where one of them cannot be written.
pub fn write_file(path: &Path, bytes: impl AsRef<[u8]>) {
    let folder = path.parent().unwrap_or(path);
    let written = std::fs::create_dir_all(folder).and_then(|()| std::fs::write(path, bytes));
    assert!(written.is_ok(), "{} cannot be written: {written:?}", path.display());
}

/// The folder of real data: `$ATSPLAT_SHARED_DATA`, or `../shared/data` beside the checkout. Where there is none the test
/// is skipped and returns.
///
/// # Panics
/// Where there is none although `ATSPLAT_REQUIRE_SHARED_DATA` is set and neither empty nor 0.
pub fn shared_data(test: &str) -> Option<PathBuf> {
    let beside = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../shared/data");
    let folder = std::env::var_os("ATSPLAT_SHARED_DATA").map_or(beside, PathBuf::from);
    if folder.is_dir() {
        return Some(folder);
    }
    let required = is_yes(std::env::var_os("ATSPLAT_REQUIRE_SHARED_DATA"));
    assert!(!required, "{test}: real data is required but absent ({})", folder.display());
    // `.ci/skips` counts these.
    skip(test, format!("no real data ({})", folder.display()));
    None
}

/// Whether `ATSPLAT_REQUIRE_GPU` is set and neither empty nor 0: no test may be skipped for want of a graphics adapter.
pub fn graphics_required() -> bool {
    is_yes(std::env::var_os("ATSPLAT_REQUIRE_GPU"))
}

fn is_yes(value: Option<OsString>) -> bool {
    value.is_some_and(|value| !value.is_empty() && value != "0")
}

/// Skips a test because no graphics adapter could be opened.
///
/// # Panics
/// Where one is required ([`graphics_required`]).
pub fn skip_without_graphics(test: &str, error: impl Display) {
    assert!(!graphics_required(), "{test}: a graphics adapter is required: {error}");
    skip(test, format!("no graphics adapter: {error}"));
}

/// Skips a test because there is no browser on the path.
///
/// # Panics
/// Where `ATSPLAT_REQUIRE_BROWSER` is set and neither empty nor 0.
pub fn skip_without_browser(test: &str) {
    let required = is_yes(std::env::var_os("ATSPLAT_REQUIRE_BROWSER"));
    assert!(!required, "{test}: a browser is required but absent (Debian's package `chromium`)");
    skip(test, "no chromium on the path");
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn empty_and_zero_require_nothing() {
        for (value, expected) in [(None, false), (Some(""), false), (Some("0"), false), (Some("1"), true)] {
            assert_eq!(is_yes(value.map(OsString::from)), expected, "{value:?}");
        }
    }
}
