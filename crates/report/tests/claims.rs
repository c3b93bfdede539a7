//! What `reports/claims` says is what its stores hold.

use std::path::{Path, PathBuf};

use atsplat_eval::Results;
use atsplat_eval::statistics::{Identical, Leaked, MetricQuery, paired_between};
use atsplat_report::definition::TableDefinition;
use atsplat_report::emit::{TableFormat, orders_as_markdown};
use atsplat_report::table::{Mixing, Source, Table, protocol_tables, tables};

fn folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../reports/claims")
}

/// Rows that no published order names side by side, or that stand in stores of two machines.
#[test]
fn paired_differences_are_those_of_the_stores() {
    let sparse = ("expansion-sparse", "k-4-1");
    let second = ("expansion-sparse-seed-2", "k-4-2");
    let pairs = [
        ("uncertainty above random selection", sparse, ("expansion-sparse", "sparse-random-1")),
        ("uncertainty above farthest-point sampling", sparse, ("expansion-sparse", "sparse-farthest-point-1")),
        (
            "uncertainty above straight-through selection",
            sparse,
            ("expansion-sparse-straight-through", "sparse-straight-through-1"),
        ),
        ("uncertainty above no expansion", sparse, ("expansion-sparse", "sparse-none-k11-1")),
        ("a second training of both: uncertainty above no expansion", second, (second.0, "sparse-none-k11-2")),
        ("a second training of both: uncertainty above random selection", second, (second.0, "sparse-random-2")),
        (
            "a second training of both: uncertainty above straight-through selection",
            second,
            (second.0, "sparse-straight-through-2"),
        ),
    ];
    let readme = std::fs::read_to_string(folder().join("README.md")).unwrap();
    let read = |name: &str| Results::read(&folder().join(name).join("store")).unwrap();
    for (claim, above, below) in pairs {
        let query = |method| MetricQuery {
            preset: "rooms-2v-64",
            method,
            metric: "psnr",
            leaked: Leaked::Included,
            identical: Identical::Excluded,
        };
        let (first, second) = (read(above.0), read(below.0));
        let found = paired_between((&first, &query(above.1)), (&second, &query(below.1))).unwrap();
        assert_eq!((found.scenes, found.targets, found.unpaired), (200, 600, 0), "{claim}");
        let [low, high] = found.interval.unwrap();
        let difference = format!("{:+.3} dB [{low:+.3}, {high:+.3}]", found.difference).replace('-', "−");
        let line = readme.lines().find(|line| line.starts_with(&format!("| {claim}"))).unwrap();
        assert!(line.contains(&difference), "{line}: {difference}");
    }
}

/// What each part of a training's recipe changes, in PSNR and SSIM.
#[test]
fn trials_of_the_recipe_are_those_of_the_store() {
    let readme = std::fs::read_to_string(folder().join("README.md")).unwrap();
    let results = Results::read(&folder().join("recipe/store")).unwrap();
    let query = |method, metric| MetricQuery {
        preset: "rooms-2v-64",
        method,
        metric,
        leaked: Leaked::Included,
        identical: Identical::Excluded,
    };
    let mut wrong = String::new();
    for (part, row) in [
        ("averaged weights", "recipe-average-1"),
        ("mirrored samples", "recipe-flips-1"),
        ("narrow windows first", "recipe-curriculum-1"),
        ("anchors pulled to exact distances", "recipe-distances-1"),
        ("more D-SSIM in the last quarter", "recipe-late-d-ssim-1"),
        ("all five", "recipe-all-1"),
    ] {
        let difference = |metric, decimals: usize| {
            let (own, plain) = (query(row, metric), query("recipe-plain-1", metric));
            let found = paired_between((&results, &own), (&results, &plain)).unwrap();
            assert_eq!((found.scenes, found.targets, found.unpaired), (200, 600, 0), "{row}");
            let [low, high] = found.interval.unwrap();
            format!("{:+.decimals$} [{low:+.decimals$}, {high:+.decimals$}]", found.difference).replace('-', "−")
        };
        let expected = format!("| {part} | {} | {} |", difference("psnr", 3), difference("ssim", 4));
        if !readme.contains(&expected) {
            wrong = format!("{wrong}\n{expected}");
        }
    }
    assert!(wrong.is_empty(), "lines that the page lacks:{wrong}");
}

#[test]
fn published_orders_are_those_of_the_stores() {
    let mut compared = 0;
    for entry in std::fs::read_dir(folder()).unwrap() {
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
