use std::collections::BTreeSet;

use super::{PageStore, escaped};
use crate::table::{Row, Table};

/// Every protocol with links to its tables and its scenes.
pub(super) fn write(tables: &[Table], stores: &[PageStore<'_>]) -> String {
    let mut seen = BTreeSet::new();
    let presets = stores.iter().flat_map(|store| &store.source.results.provenance.presets);
    let items: String = presets
        .filter(|preset| seen.insert(&preset.name))
        .map(|preset| {
            let of_protocol = tables.iter().filter(|table| is_of(table, &preset.name));
            let links: String = of_protocol
                .map(|table| format!("<a href=\"#table-{}\">{}</a>, ", escaped(&table.name), escaped(&table.title)))
                .collect();
            let name = escaped(&preset.name);
            format!(
                "<li title=\"{}\"><b>{name}</b> {links}<a href=\"#scenes\" data-protocol=\"{name}\">its scenes</a></li>",
                escaped(&preset.title)
            )
        })
        .collect();
    if items.is_empty() {
        items
    } else {
        format!("<nav aria-label=\"Protocols\"><ul class=\"protocols\">{items}</ul></nav>")
    }
}

/// Whether a row of a table was measured under a protocol.
fn is_of(table: &Table, name: &str) -> bool {
    table.rows.iter().flat_map(Row::all_measured).any(|protocol| protocol.preset == name)
}
