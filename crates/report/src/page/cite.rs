use atsplat_metrics::Definition;
use atsplat_numeric::distinct;
use atsplat_results::{MethodRecord, Provenance};

use super::PageStore;
use crate::definition::Quantity;
use crate::hashes::{short, short_commit};
use crate::plot::Origin;
use crate::table::{Cell, CellIndex, Column, LEAKED_EXCLUDED, OtherPreset, Row, StoreProtocol, Table};

/// A protocol behind a number, and the provenance of its store.
#[derive(Clone, Copy)]
struct Measured<'a> {
    protocol: &'a StoreProtocol,
    provenance: &'a Provenance,
}

/// One line with everything that a number depends on; `None` for published and absent numbers.
pub(super) fn citation(table: &Table, row: &Row, index: CellIndex, stores: &[PageStore<'_>]) -> Option<String> {
    let cell = row.cell(index);
    let number = cell.value.number().filter(|_| row.origin == Origin::Measured)?;
    let (group, column) = (&table.groups[index.group], table.column(index));
    let protocols = match &cell.difference {
        Some(difference) => difference.row.iter().collect(),
        None => row.measured(index.group),
    };
    let measured: Vec<Measured<'_>> =
        protocols.into_iter().map(|protocol| Measured::of(protocol, stores)).collect::<Option<_>>()?;
    let first = *measured.first()?;
    let reference = match &cell.difference {
        Some(difference) => Some(Measured::of(&difference.reference, stores)?),
        None => None,
    };
    // Without the interval and the marks of its cell: they follow in words.
    let number = match cell.interval {
        Some(interval) => {
            let [number, low, high] = column.format_with(number, interval);
            format!("{number} [95 % {low}, {high}]")
        }
        None => column.format(number),
    };
    let mut text = format!("{} {number}", column.title);
    text.push_str(&behind(cell, column));
    if row.without_leaked {
        text.push_str(&format!(", {LEAKED_EXCLUDED}"));
    }
    if !group.title.is_empty() {
        text.push_str(&format!(" ({})", group.title));
    }
    if row.is_over_trainings() {
        text.push_str(&format!("; method {}", row.labels.join(" ")));
        // A size over several trainings has no counts that would number them.
        if cell.trainings.is_none() {
            text.push_str(&format!(", mean of {} trainings", measured.len()));
        }
        for remark in distinct(measured.iter().flat_map(|one| &one.protocol.remarks)) {
            text.push_str(&format!(", {remark}"));
        }
        for training in &measured {
            let StoreProtocol { method, store, .. } = training.protocol;
            let facts = training.method().map(facts).unwrap_or_default();
            text.push_str(&format!("; training {method} of store {store}{facts}"));
        }
    } else {
        text.push_str(&format!("; method {}", first.in_words()));
    }
    if let Some(reference) = reference {
        text.push_str(&format!("; minus method {}", reference.in_words()));
    }
    let all = || measured.iter().chain(&reference);
    for protocol in distinct(all().filter_map(|one| one.protocol_in_words())) {
        text.push_str(&format!("; {protocol}"));
    }
    if let Quantity::Metric(metric) | Quantity::Difference(metric) = column.quantity {
        text.push_str(&format!("; {}: {}{}", metric.id, metric.convention, weights(metric, cell)));
    }
    for origin in distinct(all().map(|one| origin(one.provenance, cell))) {
        text.push_str(&format!("; {origin}"));
    }
    Some(text)
}

/// The learned weights of a metric, and that they are known not to be the published ones.
fn weights(metric: &Definition, cell: &Cell) -> String {
    let Some(sha256) = &cell.metric_weights else { return String::new() };
    let is_other = metric.network().is_some_and(|network| !network.is_published(sha256));
    format!(", weights {}{}", short(sha256), if is_other { " (not the published ones)" } else { "" })
}

/// The scenes, targets or repetitions behind a number, and those that it lacks.
fn behind(cell: &Cell, column: &Column) -> String {
    let mut text = String::new();
    if let Some(counts) = cell.counts {
        // A slope is over the targets of other columns, whose citations count them.
        let over = match column.quantity {
            Quantity::Slope(..) => {
                Some(format!("{}{}", crate::counted(counts.scenes, "scene"), counts.without_score("left out")))
            }
            _ => cell.counts_in_words(),
        };
        text.push_str(&over.map_or_else(String::new, |over| format!(" over {over}")));
        if counts.uncomputed > 0 {
            let why = cell.not_computed.as_ref().map_or_else(String::new, |why| format!(" ({why})"));
            text.push_str(&format!(", {} not computed{why}", counts.uncomputed));
        }
        if counts.outside_bins > 0 {
            text.push_str(&format!(", {} outside all bins of overlap", counts.outside_bins));
        }
    }
    if cell.is_stated_count() {
        text.push_str(", stated, not counted");
    }
    if cell.lacks_trials {
        text.push_str(", without trials that failed or are not applicable");
    }
    if let Some(timing) = &cell.timing {
        text.push_str(&timing.in_words(|secs| column.format(secs)));
    }
    text
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

impl<'a> Measured<'a> {
    fn of(protocol: &'a StoreProtocol, stores: &[PageStore<'a>]) -> Option<Self> {
        let store = stores.iter().find(|store| store.source.label == protocol.store)?;
        Some(Self { protocol, provenance: &store.source.results.provenance })
    }

    fn method(self) -> Option<&'a MethodRecord> {
        self.provenance.method(&self.protocol.method)
    }

    /// The method with its remarks, weights, renderer and devices.
    fn in_words(self) -> String {
        let method = self.method();
        let name = method.map_or(self.protocol.method.as_str(), |method| method.title.as_str());
        let remarks: String = self.protocol.remarks.iter().map(|remark| format!(", {remark}")).collect();
        format!("{name}{remarks}{}", method.map(facts).unwrap_or_default())
    }

    /// Preset, index and data, with their hashes.
    fn protocol_in_words(self) -> Option<String> {
        let preset = self.provenance.preset(&self.protocol.preset)?;
        let index = preset.index_name.as_deref().unwrap_or("unpublished");
        let (hash, index_hash) = (short(&preset.hash), short(&preset.index_sha256));
        let other = match OtherPreset::of(preset) {
            Some(OtherPreset::Changed) => " (changed)",
            Some(OtherPreset::Own) => " (own)",
            None => "",
        };
        let part = self.provenance.part().map_or_else(String::new, |part| format!(" ({part} of the run)"));
        let mut text = format!(
            "protocol {}@{hash}{other}, index {index}@{index_hash}, {} of {} entries{part}, data {}",
            preset.name, preset.entries, preset.entries_of_index, preset.dataset
        );
        if let Some(published) = &preset.stands_for {
            text.push_str(&format!(" (in place of {published}: not the published setting)"));
        }
        Some(text)
    }
}

/// What ran, and where; a time is that of its machine, which may differ from that of the scores.
fn origin(provenance: &Provenance, cell: &Cell) -> String {
    let commit =
        provenance.commit.as_deref().map_or_else(String::new, |commit| format!(" at {}", short_commit(commit)));
    let machine = match &cell.timing {
        Some(timing) => timing.machine.to_string(),
        None => format!("{}, {}", provenance.processor, crate::counted(provenance.threads.into(), "thread")),
    };
    format!("atsplat {}{commit}, {machine}", provenance.atsplat)
}
