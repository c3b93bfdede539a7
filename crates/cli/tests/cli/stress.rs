//! `atsplat stress` as a user runs it.

use crate::common::{atsplat, json_of, printed_json, succeed};
use atsplat_tests::graphics_required;

#[test]
fn prints_a_row_per_case_and_renderer() {
    let folder = tempfile::tempdir().unwrap();
    let args =
        ["stress", "--case", "needles", "--case", "not-a-number", "--renderer", "reference", "--renderer", "portable"];
    let table = succeed(folder.path(), &args);
    let lines: Vec<&str> = table.lines().collect();
    assert!(lines[0].starts_with("case") && lines[0].ends_with("verdict"), "{table}");
    for (line, start) in lines[1..5].iter().zip(["needles", "  ", "not-a-number", "  "]) {
        assert!(line.starts_with(start) && line.ends_with("0  ok"), "{table}");
    }
    assert!(table.contains("0 of 4 rows failed"), "{table}");
}

#[test]
fn writes_json_and_a_plot() {
    let folder = tempfile::tempdir().unwrap();
    let args = ["stress", "--case", "saturated", "--renderer", "cpu", "--json", "--plot", "errors.svg"];
    let report = printed_json(folder.path(), &args);
    assert_eq!(report["failed"], 0, "{report}");
    let row = &report["rows"][0];
    assert_eq!(
        (&row["case"], &row["renderer"], &row["non-finite"]),
        (&"saturated".into(), &"cpu, portable".into(), &0.into())
    );
    let names: Vec<&str> = row["errors"].as_array().unwrap().iter().map(|e| e["name"].as_str().unwrap()).collect();
    assert_eq!(names, ["image", "gradient", "differences"]);
    for error in row["errors"].as_array().unwrap() {
        assert!(error["relative"].as_f64().unwrap() <= error["bound"].as_f64().unwrap(), "{error}");
        assert!(error["compared"].as_u64().unwrap() > 0, "{error}");
    }
    let plot = std::fs::read_to_string(folder.path().join("errors.svg")).unwrap();
    assert!(plot.starts_with("<svg") && plot.contains("saturated"));
}

#[test]
fn lists_names_and_rejects_unknown_ones() {
    let folder = tempfile::tempdir().unwrap();
    let list = succeed(folder.path(), &["stress", "--list"]);
    assert!(list.lines().count() > 50 && list.contains("needle-end-on"), "{list}");
    let listed = printed_json(folder.path(), &["stress", "--list", "--json", "--case", "needle-end-on"]);
    assert_eq!(listed["cases"][0]["name"], "needle-end-on", "{listed}");
    atsplat(folder.path(), &["stress", "--case", "kittens"]).says(2, "--list");
    atsplat(folder.path(), &["stress", "--renderer", "abacus"]).says(2, "reference; cpu, portable");
    let args = ["stress", "--list", "--case", "needles", "--case", "needles"];
    atsplat(folder.path(), &args).says(2, "needles is given twice");
    for args in [["stress", "--list", "--strict"], ["adapters", "--json", "--strict"]] {
        atsplat(folder.path(), &args).says(2, "--strict");
    }
}

#[test]
fn lists_adapters() {
    let folder = tempfile::tempdir().unwrap();
    // Results of self-tests are cached in a folder of this test.
    let cache = folder.path().join("cache");
    let adapters = |args: &[&str]| {
        let start = std::time::Instant::now();
        let mut command = std::process::Command::new(env!("CARGO_BIN_EXE_atsplat"));
        let command = command.arg("adapters").args(args).env("XDG_CACHE_HOME", &cache).env("HOME", folder.path());
        let mut child =
            command.stdout(std::process::Stdio::piped()).stderr(std::process::Stdio::piped()).spawn().unwrap();
        let mut first = [0; 8];
        std::io::Read::read_exact(&mut child.stderr.take().unwrap(), &mut first).unwrap();
        let silent = start.elapsed().as_secs_f64();
        // With room for a busy machine.
        assert!(silent < 5.0, "the first sign of life came after {silent:.1} s");
        let output = child.wait_with_output().unwrap();
        assert!(output.status.success());
        String::from_utf8(output.stdout).unwrap()
    };
    let report = json_of(&adapters(&["--json"]));
    let text = adapters(&[]);
    let required = graphics_required();
    let adapters = report["adapters"].as_array().unwrap();
    let lines: Vec<&str> = text.lines().collect();
    if adapters.is_empty() {
        assert_eq!(lines, ["no graphics adapter: only --device cpu can be used"]);
    } else {
        assert_eq!(lines.len(), 2 * adapters.len(), "{text}");
    }
    for (adapter, lines) in adapters.iter().zip(lines.chunks(2)) {
        let start = format!("{}  {} (", adapter["number"], adapter["name"].as_str().unwrap());
        assert!(lines[0].starts_with(&start) && lines[0].ends_with(" MiB"), "{text}");
        let result = adapter["fault"].as_str().unwrap_or("passes its test: an image and its gradients");
        assert!(lines[1].trim_start().starts_with(result), "{text}");
        assert_eq!(adapter["cached"], false, "the first time");
        let passed = adapter["fault"].is_null();
        assert!(!passed || lines[1].contains("tested before; --again tests it again"), "the second: {text}");
    }
    assert!(!required || adapters.iter().any(|adapter| adapter["fault"].is_null()), "{report}");
}
