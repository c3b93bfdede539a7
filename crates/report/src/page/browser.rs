//! Runs pages in a real browser.

use std::path::{Path, PathBuf};
use std::process::Command;

use atsplat_tests::skip_without_browser;
use serde_json::{Map, Value};

/// Chromium; without one the test is skipped.
pub(super) fn chromium(test: &'static str) -> Option<PathBuf> {
    let names = ["chromium", "chromium-browser", "google-chrome"];
    let folders: Vec<PathBuf> =
        std::env::var_os("PATH").map(|path| std::env::split_paths(&path).collect()).unwrap_or_default();
    let found =
        names.iter().flat_map(|name| folders.iter().map(move |folder| folder.join(name))).find(|path| path.is_file());
    if found.is_none() {
        skip_without_browser(test);
    }
    found
}

/// What the test in a page sends to the window around it, in a frame of this width: windows cannot be as narrow as a
/// phone. Time is real, because images are decoded by threads that a virtual clock does not wait for. WebGL is drawn in
/// software.
pub(super) fn report_in_frame(chromium: &Path, page: &str, width: u32) -> Map<String, Value> {
    let folder = tempfile::tempdir().unwrap();
    let frame = include_str!("frame.html").replace("{width}", &width.to_string());
    for (name, text) in [("frame.html", frame.as_str()), ("page.html", page)] {
        std::fs::write(folder.path().join(name), text).unwrap();
    }
    let run = Command::new(chromium)
        .args(["--headless=new", "--no-sandbox", "--disable-dev-shm-usage", "--no-first-run"])
        .args(["--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--force-device-scale-factor=1"])
        .args(["--timeout=120000", "--dump-dom", "--window-size=1600,900"])
        .arg(format!("--user-data-dir={}", folder.path().join("profile").display()))
        .arg(format!("file://{}", folder.path().join("frame.html").display()))
        .output()
        .unwrap();
    let dom = String::from_utf8_lossy(&run.stdout);
    let (_, report) = dom.split_once("<pre id=\"selftest\" hidden=\"\">").unwrap_or_else(|| {
        panic!("the page's test did not finish: {}\n{}", String::from_utf8_lossy(&run.stderr), dom.len())
    });
    let (report, _) = report.split_once("</pre>").unwrap();
    serde_json::from_str(&report.replace("&amp;", "&").replace("&lt;", "<").replace("&gt;", ">")).unwrap()
}
