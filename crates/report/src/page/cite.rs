use super::PageStore;
use crate::definition::Quantity;
use crate::plot::Origin;
use crate::table::{Place, Row, Table, Trainings, short};

/// One line with everything that a number depends on; `None` for published and absent numbers.
pub(super) fn citation(table: &Table, row: &Row, place: Place, stores: &[PageStore<'_>]) -> Option<String> {
    let cell = row.cell(place);
    cell.value.number().filter(|_| row.origin == Origin::Measured)?;
    let (group, column) = (&table.groups[place.0], table.column(place));
    let protocol = row.protocol(place.0)?;
    let store = stores.iter().find(|store| store.source.label == protocol.store)?;
    let provenance = &store.source.results.provenance;
    let mut text = format!("{} {}", column.title, cell.print(column));
    if let Some([low, high]) = cell.interval {
        text.push_str(&format!(" [95 % {}, {}]", column.format(low), column.format(high)));
    }
    if let Some(counts) = cell.counts {
        text.push_str(&format!(" over {} scenes, {} targets", counts.scenes, counts.targets));
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
    let method = provenance.methods.iter().find(|method| Some(&method.name) == row.method.as_ref());
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
        for (what, hash) in
            [("weights", &method.weights_sha256), ("constants", &method.constants), ("backend", &method.backend)]
        {
            if let Some(hash) = hash {
                text.push_str(&format!(", {what} {}", short(hash)));
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
