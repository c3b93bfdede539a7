//! What `reports/claims` says is what its stores hold.

use std::path::Path;

use atsplat_eval::Results;
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
