//! `atsplat data` as a user runs it.

mod common;

use common::{atsplat, succeed, write_trajectory};

#[test]
fn a_trajectory_folder_is_inspected_and_exported_three_ways() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    std::fs::create_dir(here.join("data")).unwrap();
    write_trajectory(&here.join("data/aaaa.txt"), 20);
    write_trajectory(&here.join("data/bbbb.txt"), 30);
    std::fs::write(here.join("data/broken.txt"), "https://example.org\n1 2 3\n").unwrap();

    let report = succeed(here, &["data", "inspect", "data", "--json"]);
    let report: serde_json::Value = serde_json::from_str(&report).unwrap();
    assert_eq!(report["format"], "re10k", "{report}");
    assert_eq!(atsplat(here, &["--strict", "data", "inspect", "data"]).code, 4, "a broken file is a skipped scene");

    for out in ["cameras.parquet", "cameras.arrow", "cameras.csv"] {
        let text = succeed(here, &["data", "export", "data", out]);
        assert!(text.starts_with("2 scenes, 50 frames, "), "{text}");
        assert!(text.contains("1 scenes skipped"), "{text}");
    }
    let csv = std::fs::read_to_string(here.join("cameras.csv")).unwrap();
    assert_eq!(csv.lines().count(), 51, "a header and a line per frame");
}

#[test]
fn unknown_data_and_unknown_outputs_are_named() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    std::fs::create_dir(here.join("empty")).unwrap();
    let empty = atsplat(here, &["data", "inspect", "empty"]);
    assert_eq!(empty.code, 1);
    assert!(empty.stderr.contains("empty"), "{}", empty.stderr);
    write_trajectory(&here.join("a.txt"), 3);
    let outcome = atsplat(here, &["data", "export", "a.txt", "cameras.xlsx"]);
    assert_eq!(outcome.code, 1);
    assert!(outcome.stderr.contains("cameras.xlsx"), "{}", outcome.stderr);
}
