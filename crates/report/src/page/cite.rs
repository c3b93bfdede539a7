use atsplat_eval::{MethodRecord, Provenance};

use super::PageStore;
use crate::counted;
use crate::definition::Quantity;
use crate::plot::Origin;
use crate::table::{Cell, Place, Row, StoreProtocol, Table, Trainings, distinct, short};

/// One line with everything that a number depends on; `None` for published and absent numbers.
pub(super) fn citation(table: &Table, row: &Row, place: Place, stores: &[PageStore<'_>]) -> Option<String> {
    let cell = row.cell(place);
    cell.value.number().filter(|_| row.origin == Origin::Measured)?;
    let (group, column) = (&table.groups[place.0], table.column(place));
    let measured: Vec<(&StoreProtocol, &Provenance)> = row
        .measured(place.0)
        .into_iter()
        .map(|own| {
            let store = stores.iter().find(|store| store.source.label == own.store)?;
            Some((own, &store.source.results.provenance))
        })
        .collect::<Option<_>>()?;
    let (first, provenance) = *measured.first()?;
    // The interval follows with its level, which cells that print theirs leave out.
    let printed = Cell { interval: None, ..cell.clone() }.print(column);
    let mut text = format!("{} {printed}", column.title);
    if let Some([low, high]) = cell.interval {
        text.push_str(&format!(" [95 % {}, {}]", column.format(low), column.format(high)));
    }
    // A slope is over the targets of other columns, whose citations count them.
    let is_slope = matches!(column.quantity, Quantity::Slope(..));
    if let Some(counts) = cell.counts.filter(|_| !is_slope) {
        text.push_str(&format!(" over {}, {}", counted(counts.scenes, "scene"), counted(counts.targets, "target")));
    }
    if let Some(Trainings { count, .. }) = cell.trainings {
        text.push_str(&format!(" of {count} trainings"));
    }
    if row.without_leaked {
        text.push_str(", leaked targets excluded");
    }
    if !group.title.is_empty() {
        text.push_str(&format!(" ({})", group.title));
    }
    let method = method_of(first, provenance).filter(|_| !row.is_over_trainings());
    let name = method.map_or_else(|| row.labels.join(" "), |method| method.title.clone());
    text.push_str(&format!("; method {name}"));
    if row.untrained {
        text.push_str(", untrained");
    }
    if row.inference_only {
        text.push_str(", changed at inference only");
    }
    if row.is_over_trainings() {
        for (own, provenance) in &measured {
            let facts = method_of(own, provenance).map(facts).unwrap_or_default();
            text.push_str(&format!("; training {} of store {}{facts}", own.method, own.store));
        }
    } else {
        text.push_str(&method.map(facts).unwrap_or_default());
    }
    for protocol in distinct(measured.iter().filter_map(|(own, provenance)| protocol(own, provenance))) {
        text.push_str(&format!("; {protocol}"));
    }
    if let Quantity::Metric(metric) = column.quantity {
        text.push_str(&format!("; {}: {}", metric.id, metric.convention));
    }
    for origin in distinct(measured.iter().map(|(_, provenance)| origin(provenance))) {
        text.push_str(&format!("; {origin}"));
    }
    Some(text)
}

fn method_of<'a>(own: &StoreProtocol, provenance: &'a Provenance) -> Option<&'a MethodRecord> {
    provenance.methods.iter().find(|method| method.name == own.method)
}

/// Weights, renderer and devices of a method.
fn facts(method: &MethodRecord) -> String {
    let mut text = String::new();
    for (what, adapter) in [("network", &method.network_adapter), ("renderer", &method.renderer_adapter)] {
        if let Some(adapter) = adapter {
            text.push_str(&format!(", {what} on {adapter}"));
        }
    }
    let weights = method.weights_sha256.as_deref().map(short);
    for (what, name) in [("weights", &weights), ("constants", &method.constants), ("backend", &method.backend)] {
        if let Some(name) = name {
            text.push_str(&format!(", {what} {name}"));
        }
    }
    text
}

fn protocol(own: &StoreProtocol, provenance: &Provenance) -> Option<String> {
    let preset = provenance.presets.iter().find(|preset| preset.name == own.preset)?;
    let index = preset.index_name.as_deref().unwrap_or("unpublished");
    let (hash, digest) = (short(&preset.hash), short(&preset.index_sha256));
    let mut text = format!(
        "protocol {}@{hash}, index {index}@{digest}, {} of {} entries, data {}",
        preset.name, preset.entries, preset.entries_of_index, preset.dataset
    );
    if let Some(published) = &preset.stands_for {
        text.push_str(&format!(" (in place of {published}: not the published setting)"));
    }
    Some(text)
}

/// What ran, and where.
fn origin(provenance: &Provenance) -> String {
    let commit = provenance.commit.as_deref().map_or_else(String::new, |commit| format!(" at {}", short(commit)));
    format!("atsplat {}{commit}, {}, {} threads", provenance.atsplat, provenance.processor, provenance.threads)
}
