//! What `reports/claims` says is what its stores hold.

use std::path::Path;

use atsplat_eval::Results;
use atsplat_eval::statistics::{Identical, Leaked, MetricQuery, paired};
use atsplat_report::definition::TableDefinition;
use atsplat_report::emit::{TableFormat, orders_as_markdown};
use atsplat_report::table::{Mixing, Source, Table, protocol_tables, tables};

#[test]
fn published_orders_are_those_of_the_stores() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../reports/claims");
    let mut compared = 0;
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if !path.join("store").is_dir() {
            continue;
        }
        let results = Results::read(&path.join("store")).unwrap();
        let source = Source { label: "store", results: &results };
        let built: Vec<_> = TableDefinition::names()
            .flat_map(|name| tables(&TableDefinition::named(name).unwrap(), &[source], Mixing::Apart).unwrap())
            .filter(Table::is_measured)
            .collect();
        // Folders whose tables hold no published order show slopes: the table of their protocol.
        let (built, file) = if let Some(orders) = orders_as_markdown(&built) {
            (orders, "orders.md")
        } else {
            let protocols = protocol_tables(&[source], Mixing::Apart).unwrap();
            assert_eq!(protocols.len(), 1, "{}", path.display());
            (TableFormat::Markdown.write(&protocols[0]).unwrap(), "protocol.md")
        };
        let committed = std::fs::read_to_string(path.join(file)).unwrap();
        assert_eq!(built, committed, "{}", path.display());
        compared += 1;
    }
    assert!(compared > 0, "no claims");
}

#[test]
fn parts_of_the_recipe_are_kept_by_their_intervals() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../reports/claims");
    let results = Results::read(&folder.join("recipe/store")).unwrap();
    let text = std::fs::read_to_string(folder.join("README.md")).unwrap();
    let query = |row| MetricQuery {
        preset: "rooms-2v-64",
        method: row,
        metric: "psnr",
        leaked: Leaked::Included,
        identical: Identical::Excluded,
    };
    for (row, part) in [
        ("recipe-average-1", "weights averaged over about fifty steps"),
        ("recipe-flips-1", "half of the samples mirrored"),
        ("recipe-curriculum-1", "narrow windows first"),
        ("recipe-distances-1", "anchors pulled to exact distances"),
        ("recipe-late-d-ssim-1", "four times the weight of D-SSIM in the last quarter"),
        ("recipe-all-1", "all of them"),
    ] {
        let found = paired(&results, &query(row), &query("recipe-plain-1")).unwrap();
        let [low, high] = found.interval.unwrap();
        let verdict = match (low > 0.0, high < 0.0) {
            (true, _) => "helps",
            (_, true) => "harms",
            _ => "undecided",
        };
        let line =
            format!("| {part} | {:+.3} dB [{low:+.3}, {high:+.3}] | {verdict} |", found.difference).replace('-', "−");
        let text = text.replace('-', "−");
        assert!(text.contains(&line), "expected in reports/claims/README.md: {line}");
    }
}
