use super::PageStore;
use crate::counted;
use crate::definition::Quantity;
use crate::plot::Origin;
use crate::table::{Cell, Place, Row, Table, Trainings, short};

/// One line with everything that a number depends on; `None` for published and absent numbers.
pub(super) fn citation(table: &Table, row: &Row, place: Place, stores: &[PageStore<'_>]) -> Option<String> {
    let cell = row.cell(place);
    cell.value.number().filter(|_| row.origin == Origin::Measured)?;
    let (group, column) = (&table.groups[place.0], table.column(place));
    let protocol = row.protocol(place.0)?;
    let store = stores.iter().find(|store| store.source.label == protocol.store)?;
    let provenance = &store.source.results.provenance;
    // The interval follows with its level, which cells that print theirs leave out.
    let printed = Cell { interval: None, ..cell.clone() }.print(column);
    let mut text = format!("{} {printed}", column.title);
    if let Some([low, high]) = cell.interval {
        text.push_str(&format!(" [95 % {}, {}]", column.format(low), column.format(high)));
    }
    if let Some(counts) = cell.counts {
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
    let is_mean = row.is_over_trainings();
    let method = provenance.methods.iter().find(|method| !is_mean && method.name == protocol.method);
    let name = method.map_or_else(|| row.labels.join(" "), |method| method.title.clone());
    text.push_str(&format!("; method {name}"));
    if row.untrained {
        text.push_str(", untrained");
    }
    if row.inference_only {
        text.push_str(", changed at inference only");
    }
    if let Some(method) = method {
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
    }
    if let Some(preset) = provenance.presets.iter().find(|preset| preset.name == protocol.preset) {
        let index = preset.index_name.as_deref().unwrap_or("unpublished");
        let (hash, digest) = (short(&preset.hash), short(&preset.index_sha256));
        text.push_str(&format!(
            "; protocol {}@{hash}, index {index}@{digest}, {} of {} entries, data {}",
            preset.name, preset.entries, preset.entries_of_index, preset.dataset
        ));
        if let Some(published) = &preset.stands_for {
            text.push_str(&format!(" (in place of {published}: not the published setting)"));
        }
    }
    if let Quantity::Metric(metric) = column.quantity {
        text.push_str(&format!("; {}: {}", metric.id, metric.convention));
    }
    let commit = provenance.commit.as_deref().map_or_else(String::new, |commit| format!(" at {}", short(commit)));
    text.push_str(&format!(
        "; atsplat {}{commit}, {}, {} threads",
        provenance.atsplat, provenance.processor, provenance.threads
    ));
    Some(text)
}
