//! Tests of the page in a browser.

use atsplat_pixels::{ImageU8, encode_png};
use atsplat_results::store::images::image_path;
use atsplat_results::{TargetRow, TargetStatus, TrialStatus};

use super::browser::{chromium, report_in_frame};
use super::tests::Sample;
use super::*;
use crate::sample::{SCENES, UNBROKEN};

#[test]
fn a_browser_clicks_through_the_page() {
    let Some(chromium) = chromium("a_browser_clicks_through_the_page") else { return };
    let mut sample = Sample::new();
    // A metric of which less is better.
    for row in &mut sample.results.targets {
        let error = row.scores.get("psnr").map(|psnr| 1.0 - psnr / 40.0);
        row.scores.extend(error.map(|error| ("l1".to_owned(), error)));
    }
    // Differences that are printed as 0, of either sign.
    for row in sample.results.targets.iter_mut().filter(|row| row.scores.contains_key("ssim")) {
        let is_first = row.key.method == "atsplat";
        let others = if row.key.scene == SCENES[1] { 0.4998 } else { 0.5002 };
        row.scores.insert("ssim".to_owned(), if is_first { 0.5 } else { others });
    }
    // One target is far better under the first method than its others, and identical to the truth under the last one of the list.
    let in_one = |row: &&mut TargetRow| row.key.scene == SCENES[0] && row.target == 1;
    for row in sample.results.targets.iter_mut().filter(in_one) {
        match row.key.method.as_str() {
            "atsplat" => *row.scores.get_mut("psnr").unwrap() += 6.0,
            "nearest-view" => {
                row.status = TargetStatus::Identical;
                row.scores.retain(|metric, _| metric == "ssim");
            }
            _ => {}
        }
    }
    let page = sample.write(usize::MAX, Some(include_str!("selftest.js")));
    for width in [1280, 500] {
        let checks = report_in_frame(&chromium, &page, width);
        let failed: Vec<&String> =
            checks.iter().filter(|(_, passed)| **passed != Value::Bool(true)).map(|(name, _)| name).collect();
        assert!(failed.is_empty() && checks.len() >= 15, "{width} px: failed {failed:?} of {checks:?}");
    }
}

#[test]
fn nothing_is_clipped_on_phones_desks_and_paper() {
    let Some(chromium) = chromium("nothing_is_clipped_on_phones_desks_and_paper") else { return };
    let mut sample = Sample::new();
    let name = |at: usize| format!("{UNBROKEN}_v{at}");
    for (at, method) in sample.results.provenance.methods.iter_mut().enumerate() {
        method.title = name(at);
    }
    for row in sample.tables.iter_mut().flat_map(|table| &mut table.rows).filter(|row| row.method.is_some()) {
        row.labels[0] = name(0);
    }
    // Two methods are compared.
    let layout = format!(
        "{{ const compared = document.getElementById('compared'); compared.value = compared.options[1].value; \
         compared.dispatchEvent(new Event('change')); }}{}",
        include_str!("layout.js")
    );
    let findings = |width, script: &str| {
        let report = report_in_frame(&chromium, &sample.write(usize::MAX, Some(script)), width);
        assert_eq!(report["print"], Value::Bool(width == 750));
        report["findings"].as_array().unwrap().iter().map(|text| text.as_str().unwrap().to_owned()).collect::<Vec<_>>()
    };
    for width in [390, 750, 1400] {
        assert_eq!(findings(width, &layout), Vec::<String>::new(), "at {width} px");
    }
    let with = |style: &str| {
        format!(
            "document.body.append(Object.assign(document.createElement('style'), {{ textContent: '{style}' }}));{layout}"
        )
    };
    let broken = [
        (390, "h3 { white-space: nowrap; overflow: hidden; width: 3rem }", "clipped: h3"),
        (390, "td.number { font-size: 10px }", "text of 10.0 px: td"),
        (390, ".plots figure > svg { width: 100% }", "px: text"),
        (750, "td.number { color: #e6e9ee !important }", "light on paper: td"),
        (750, "svg [fill=\"#1F2328\"] { fill: #e6e9ee }", "light on paper: text"),
        (1400, "body { overflow-wrap: normal }", "over the next column"),
        (1400, ".slider .tag { max-width: none }", "over the other"),
        (750, "table.numbers td { padding: 0 2rem }", "columns are outside"),
        (1400, "#tables { width: 1500px }", "the page is 15"),
    ];
    for (width, style, expected) in broken {
        let found = findings(width, &with(style));
        assert!(found.iter().any(|text| text.contains(expected)), "{style}: {found:?}");
    }
}

/// All renders have half the size of the truth and were refused: there is no metric and no error map, but reasons and images.
#[test]
fn a_browser_shows_trials_that_all_failed() {
    let Some(chromium) = chromium("a_browser_shows_trials_that_all_failed") else { return };
    let mut sample = Sample::new();
    sample.tables.clear();
    sample.plots.clear();
    let small = encode_png(&ImageU8::new(8, 8, vec![9; 192]).unwrap()).unwrap();
    for row in &mut sample.results.targets {
        row.status = TargetStatus::Failed;
        row.scores.clear();
        let render = image_path(sample.folder.path(), &row.key, row.frame);
        if render.is_file() {
            std::fs::write(render, &small).unwrap();
        }
    }
    for trial in &mut sample.results.trials {
        (trial.status, trial.detail) = (TrialStatus::Failed, Some("the renders are too small".to_owned()));
    }
    let page = sample.write(usize::MAX, Some(include_str!("failed_selftest.js")));
    let report = report_in_frame(&chromium, &page, 1280);
    assert_eq!(report["marks"], Value::from(vec!["failed"; 4]));
    assert_eq!(report["reasons"], Value::from(vec!["the renders are too small"; 4]));
    assert_eq!(report["maps"], json!(["The sizes differ: 8×8, not 16×16."]));
    assert_eq!((&report["canvases"], &report["sliders"]), (&json!(0), &json!(1)));
}
