//! The numbers of the README are those of the reference report.

#![expect(clippy::unwrap_used, reason = "helpers of tests fail like tests")]

use std::path::Path;

/// What the README and the report call the same row.
const ROWS: [[&str; 2]; 4] = [
    ["ATSplat (`micro-rooms`)", "ATSplat (micro-rooms)"],
    ["same weights, no expansion at inference", "ATSplat (micro-rooms, no expansion), changed at inference only"],
    ["nearest view", "nearest view"],
    ["plane warp", "plane warp"],
];

fn read(path: &str) -> String {
    std::fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join("../..").join(path)).unwrap()
}

#[test]
fn the_quick_suites_rows_are_those_of_the_reference_report() {
    let readme = read("README.md");
    let table = read("reports/reference/tables/protocol-rooms-2v-128.md").replace('\\', "").replace("**", "");
    let table = table.replace("<u>", "").replace("</u>", "");
    for [shown, method] in ROWS {
        let row = table.lines().find(|line| line.starts_with(&format!("| {method} |"))).unwrap();
        let cells: Vec<&str> = row.split(" | ").collect();
        let expected = format!("| {shown} | {} | {} |", cells[2], cells[3]);
        assert!(readme.lines().any(|line| line == expected), "the README lacks {expected}");
    }
}
