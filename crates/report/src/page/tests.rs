//! The page as text, and as a browser sees it.

use std::path::{Path, PathBuf};
use std::process::Command;

use atsplat_eval::runner::picture_path;
use atsplat_eval::{Results, TrialKey};
use atsplat_pixels::{ImageU8, encode_png};
use atsplat_tests::skip;

use super::*;
use crate::definition::TableDefinition;
use crate::figures::{of_store, of_table};
use crate::sample::{HOSTILE, store};
use crate::table::{Mixing, tables};

/// What a page is made of, kept alive.
struct Sample {
    results: Results,
    folder: tempfile::TempDir,
    tables: Vec<Table>,
    plots: Vec<(String, Drawing)>,
}

impl Sample {
    fn new() -> Self {
        let mut results = store();
        results.provenance.command.push(HOSTILE.to_owned());
        results.provenance.methods[1].untrained = true;
        let folder = tempfile::tempdir().unwrap();
        for row in results.targets.iter().filter(|row| !row.scores.is_empty()) {
            for method in [TRUTH, row.key.method.as_str()] {
                let key = TrialKey { method: method.to_owned(), ..row.key.clone() };
                keep(&picture_path(folder.path(), &key, row.frame), row.target + u32::from(method != TRUTH));
            }
        }
        let source = Source { label: LABEL, results: &results };
        let (mut all, mut plots) = (Vec::new(), Vec::new());
        for name in TableDefinition::names() {
            let definition = TableDefinition::named(name).unwrap();
            for table in tables(&definition, &[source], Mixing::Apart).unwrap() {
                plots.extend(of_table(&definition, &table, &[source]));
                all.extend(table.is_measured().then_some(table));
            }
        }
        plots.extend(of_store(&source).unwrap());
        Self { tables: all, plots, results, folder }
    }

    fn write(&self, budget: PictureBudget, extra: Option<&str>) -> String {
        let source = Source { label: LABEL, results: &self.results };
        let stores = [PageStore { source, folder: Some(self.folder.path()) }];
        let page = Page {
            title: format!("Report {HOSTILE}"),
            tables: &self.tables,
            plots: &self.plots,
            sections: &[],
            stores: &stores,
            budget,
        };
        page.write_with(extra).unwrap()
    }
}

const TRUTH: &str = "truth";
const LABEL: &str = "run <b>1</b>";

fn keep(path: &Path, seed: u32) {
    // Neighbouring seeds differ by five levels everywhere, so that an error map has room to grow brighter.
    let sample = |at: u32| u8::try_from((at * 37 + at * at % 251) % 200 + seed * 5).unwrap();
    let picture = ImageU8::new(16, 16, (0..768).map(sample).collect()).unwrap();
    std::fs::create_dir_all(path.parent().unwrap()).unwrap();
    std::fs::write(path, encode_png(&picture).unwrap()).unwrap();
}

#[test]
fn nothing_from_data_becomes_markup() {
    let page = Sample::new().write(PictureBudget::default(), None);
    assert_eq!(page.matches("<script").count(), 2, "the data and the page's own");
    assert_eq!(page.matches("</script").count(), 2);
    assert!(!page.contains("<b>1</b>") && page.contains("run &lt;b&gt;1&lt;/b&gt;"));
    let (_, data) = page.split_once("id=\"data\">").unwrap();
    let (data, _) = data.split_once("</script>").unwrap();
    let data: Value = serde_json::from_str(data).unwrap();
    let scenes: Vec<&str> =
        data["runs"][0]["trials"].as_array().unwrap().iter().map(|trial| trial["scene"].as_str().unwrap()).collect();
    assert!(scenes.contains(&HOSTILE), "and the data is what it was: {scenes:?}");
}

#[test]
fn nothing_is_loaded_from_anywhere() {
    let page = Sample::new().write(PictureBudget::default(), None);
    assert!(page.contains("default-src 'none'") && page.contains(&hash_of(SCRIPT)));
    for part in page.split(['<', ';']) {
        for loading in ["src=\"", "href=\"", "url(", "@import"] {
            if let Some((_, target)) = part.split_once(loading) {
                assert!(
                    target.starts_with('#') || target.starts_with("data:"),
                    "{loading}{}",
                    &target[..target.len().min(60)]
                );
            }
        }
    }
}

#[test]
fn pictures_keep_to_their_budget_and_say_what_is_missing() {
    let sample = Sample::new();
    let uris = |bytes| {
        let page = sample.write(PictureBudget { bytes }, None);
        let total: usize = page.match_indices("data:image/png").map(|(at, _)| page[at..].find('"').unwrap()).sum();
        (page, total)
    };
    let (page, all) = uris(usize::MAX);
    assert!(all > 10_000 && page.contains("66 of 66 pictures"), "{all}");
    let (page, some) = uris(all / 3);
    assert!(some <= all / 3 && some > all / 6 && page.contains("would make it too large"), "{some} of {all}");
    let (page, none) = uris(0);
    assert!(none == 0 && page.contains("0 of 66 pictures"));
}

#[test]
fn a_file_that_is_no_picture_stays_outside() {
    let sample = Sample::new();
    let row = &sample.results.targets[0];
    std::fs::write(picture_path(sample.folder.path(), &row.key, row.frame), "\u{89}PNG\r\n<script>").unwrap();
    assert!(sample.write(PictureBudget::default(), None).contains("1 cannot be read"));
}

#[test]
fn slots_are_filled_once() {
    assert_eq!(filled("a {{x}} b {{y}}{{z}}", &[("x", "{{y}}".to_owned()), ("y", "1".to_owned())]), "a {{y}} b 1");
    assert_eq!(filled("open {{x", &[]), "open {{x");
}

/// Chromium, which has to be there where `CI` is set.
fn chromium() -> Option<PathBuf> {
    let names = ["chromium", "chromium-browser", "google-chrome"];
    let folders: Vec<PathBuf> =
        std::env::var_os("PATH").map(|path| std::env::split_paths(&path).collect()).unwrap_or_default();
    let found =
        names.iter().flat_map(|name| folders.iter().map(move |folder| folder.join(name))).find(|path| path.is_file());
    let required = std::env::var("CI").is_ok_and(|value| value == "true" || value == "1");
    assert!(found.is_some() || !required, "this test needs chromium (Debian package `chromium`), and CI is set");
    if found.is_none() {
        skip("a_browser_clicks_through_the_page", "no chromium on the path");
    }
    found
}

#[test]
fn a_browser_clicks_through_the_page() {
    let Some(chromium) = chromium() else { return };
    let sample = Sample::new();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("page.html");
    std::fs::write(&path, sample.write(PictureBudget::default(), Some(include_str!("selftest.js")))).unwrap();
    for size in ["1280,900", "500,900"] {
        let run = Command::new(&chromium)
            .args(["--headless=new", "--no-sandbox", "--disable-gpu", "--disable-dev-shm-usage", "--no-first-run"])
            .args(["--virtual-time-budget=20000", "--timeout=120000", "--dump-dom"])
            .arg(format!("--window-size={size}"))
            .arg(format!("--user-data-dir={}", folder.path().join("profile").display()))
            .arg(format!("file://{}", path.display()))
            .output()
            .unwrap();
        let dom = String::from_utf8_lossy(&run.stdout);
        let (_, told) = dom.split_once("<pre id=\"selftest\" hidden=\"\">").unwrap_or_else(|| {
            panic!("the page's test did not end: {}\n{}", String::from_utf8_lossy(&run.stderr), dom.len())
        });
        let (told, _) = told.split_once("</pre>").unwrap();
        let told: serde_json::Map<String, Value> = serde_json::from_str(&told.replace("&amp;", "&")).unwrap();
        let failed: Vec<&String> =
            told.iter().filter(|(_, passed)| **passed != Value::Bool(true)).map(|(name, _)| name).collect();
        assert!(failed.is_empty() && told.len() >= 15, "{size}: failed {failed:?} of {told:?}");
    }
}
