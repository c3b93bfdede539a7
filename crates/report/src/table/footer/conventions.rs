//! Protocols, metrics with their weights, renderers and training data; what was skipped or not computed.

use std::collections::{BTreeMap, BTreeSet};

use atsplat_metrics::Definition;
use atsplat_numeric::{distinct, grouped};
use atsplat_results::RunWarning;

use super::{Notes, counts_of_each};
use crate::counted;
use crate::definition::TableDefinition;
use crate::hashes::short;
use crate::table::selection::{ComparableResults, MethodRun, Part, is_network_of_another_seed};
use crate::table::{Cell, Counts, NoteKind, Table, Value};

/// The stores behind each hash of a learned metric's weights.
type WeightsOfStores<'a> = BTreeMap<&'a str, BTreeSet<&'a str>>;

impl Notes {
    pub(super) fn protocols(&mut self, table: &Table, results: &ComparableResults<'_>) {
        for part in &results.parts {
            self.protocol(part);
            let difference = part.difference_from_published(&part.methods_in(&table.rows));
            for difference in difference.iter().chain(&part.unfinished) {
                self.add(NoteKind::Setting, format!("not the published setting: {difference}"));
            }
            if let Some(why) = part.forced_overlaps().filter(|_| results.forced) {
                self.add(NoteKind::Forced, format!("{why}; they are binned nevertheless because of --force"));
            }
            self.warnings(part);
            self.skipped(part);
        }
        self.renderers(results);
        self.renderers_of_settings(table, results);
    }

    fn protocol(&mut self, part: &Part<'_>) {
        let preset = part.preset;
        let index = preset.index_name.as_deref().unwrap_or(&preset.index);
        let (hash, index_hash) = (short(&preset.hash), short(&preset.index_sha256));
        let text = format!("{}: protocol {hash}, index {index} {index_hash}, data {}", preset.name, preset.dataset);
        self.add(NoteKind::Convention, text);
    }

    fn warnings(&mut self, part: &Part<'_>) {
        let preset = &part.preset.name;
        for warning in part.source.results.provenance.warnings.iter().filter(|warning| warning.preset == *preset) {
            let is_one_of_several = warning.count > 1 && RunWarning::MissingScenes.is_of(&warning.kind);
            let before = if is_one_of_several { ", such as" } else { ":" };
            let text = format!("{preset}: {} {}{before} {}", warning.count, warning.kind, warning.example);
            self.add(NoteKind::Counts, text);
        }
    }

    fn skipped(&mut self, part: &Part<'_>) {
        let preset = &part.preset.name;
        let skipped = part.source.results.provenance.skipped.iter().filter(|entry| entry.preset == *preset);
        // Methods with other poses may give other reasons for one entry.
        let entries: BTreeSet<(&str, u32)> = skipped.clone().map(|entry| (entry.scene.as_str(), entry.entry)).collect();
        if entries.is_empty() {
            return;
        }
        let reasons = counts_of_each(skipped.map(|entry| entry.reason.as_str())).into_iter();
        let reasons = reasons.map(|(reason, count)| format!("{reason} {count}")).collect::<Vec<_>>().join(", ");
        let text = format!("{preset}: {} skipped ({reasons})", counted(entries.len() as u64, "index entry"));
        self.add(NoteKind::Counts, text);
    }

    fn renderers(&mut self, results: &ComparableResults<'_>) {
        let methods = results.parts.iter().flat_map(|part| &part.source.results.provenance.methods);
        let renderers: BTreeSet<(&str, &str)> = methods
            .filter_map(|method| {
                Some((method.constants.as_deref()?, method.backend.as_deref().unwrap_or("not recorded")))
            })
            .collect();
        for (constants, backend) in renderers {
            self.add(NoteKind::Convention, format!("renderer: constants {constants}, backend {backend}"));
        }
    }

    /// Methods that are rendered as the protocol lists for the published method whose setting they name.
    fn renderers_of_settings(&mut self, table: &Table, results: &ComparableResults<'_>) {
        for MethodRun { part, record } in results.methods_in(table) {
            let is_listed = |setting: &&str| part.protocol.renderer_overrides_of(setting).is_some();
            let Some(setting) = record.setting().filter(is_listed) else { continue };
            if record.has_constants_of_preset() {
                let renderer = part.protocol.renderer_for(setting);
                let of_preset = record.has_background_of_preset();
                let background = if of_preset { format!(", on {:?}", renderer.background) } else { String::new() };
                let (preset, rasteriser) = (&part.preset.name, &renderer.rasteriser);
                let text =
                    format!("{} is rendered as {preset} lists for {setting}: {rasteriser}{background}", record.title);
                self.add(NoteKind::Convention, text);
            }
        }
    }

    /// The convention of each metric with its learned weights, then the scores that were not computed.
    pub(super) fn metrics(&mut self, table: &Table, definition: &TableDefinition, results: &ComparableResults<'_>) {
        for (_, column) in table.columns() {
            if let Some(metric) = column.quantity.metric() {
                let weights = weights_of(metric, results);
                let hashes: Vec<String> = weights.keys().map(|hash| short(hash)).collect();
                let text = if hashes.is_empty() { String::new() } else { format!("; weights {}", hashes.join(", ")) };
                self.add(NoteKind::Convention, format!("{}: {}{text}", metric.name, metric.convention));
                self.differing_weights(metric, &weights);
            }
        }
        self.not_computed(table, definition);
    }

    /// Weights that are not the published ones, or not the same in all stores: a file of the published name may contain any.
    fn differing_weights(&mut self, metric: &Definition, weights: &WeightsOfStores<'_>) {
        let Some(network) = metric.network() else { return };
        for hash in weights.keys().filter(|hash| !network.is_published(hash)) {
            let text = format!(
                "{}: the weights {} are not those of the published {}: not comparable with published numbers",
                metric.name,
                short(hash),
                network.file()
            );
            self.add(NoteKind::Setting, text);
        }
        if weights.len() > 1 {
            let stores = |(hash, stores): (&&str, &BTreeSet<&str>)| {
                format!("{} in {}", short(hash), stores.iter().copied().collect::<Vec<_>>().join(", "))
            };
            let all = weights.iter().map(stores).collect::<Vec<_>>().join("; ");
            let text =
                format!("{}: the weights differ between stores, whose rows are not comparable: {all}", metric.name);
            self.add(NoteKind::Setting, text);
        }
    }

    fn not_computed(&mut self, table: &Table, definition: &TableDefinition) {
        for (index, column) in table.columns() {
            let is_of_bin = definition.groups.get(index.group).is_some_and(|group| group.targets.is_by_overlap());
            for row in &table.rows {
                let Cell { value, counts, not_computed: Some(reason), .. } = row.cell(index) else { continue };
                let text = match (value, counts) {
                    (Value::Number(_), Some(Counts { targets, uncomputed, .. })) => format!(
                        "{} of {}: not computed for {uncomputed} of {}, and not ranked: {reason}",
                        table.heading(index),
                        row.printed_name(),
                        counted(targets + uncomputed, "target")
                    ),
                    // The metric was computed, but not put in bins.
                    (_, None) if is_of_bin => format!("n/c {} by overlap: not computed: {reason}", column.title),
                    _ => format!("n/c {}: not computed: {reason}", column.title),
                };
                self.add(NoteKind::NotComputed, text);
            }
        }
    }

    /// The training data of the networks in the table.
    pub(super) fn trained_on(&mut self, table: &Table, results: &ComparableResults<'_>) {
        for MethodRun { record, .. } in results.methods_in(table) {
            if let Some(training) = &record.training {
                self.add(NoteKind::Convention, format!("{}: trained on {}", record.title, training.data));
            }
        }
    }

    /// Trainings of one network from different seeds that are not averaged, because their data is not stated in the same words.
    pub(super) fn apart_by_data(&mut self, table: &Table, results: &ComparableResults<'_>) {
        let mut left = results.methods_in(table);
        while let Some(first) = left.first().copied() {
            let is_same = |run: &MethodRun<'_>| {
                (&run.record.kind, &run.record.parameters) == (&first.record.kind, &first.record.parameters)
            };
            let (same, others) = left.into_iter().partition::<Vec<_>, _>(is_same);
            left = others;
            if let Some(trainings) = trainings_by_data(&same) {
                let title = &first.record.title;
                let text = format!(
                    "{title}: trainings are only averaged if their data is stated in the same words: {trainings}"
                );
                self.add(NoteKind::Trainings, text);
            }
        }
    }
}

/// `a on rooms; b, c on yards`: trainings of one network by the words for their data; `None` if these keep none of them apart.
fn trainings_by_data(runs: &[MethodRun<'_>]) -> Option<String> {
    let data = |run: &MethodRun<'_>| run.record.training.as_ref().map(|training| training.data.clone());
    let is_apart =
        |a: &MethodRun<'_>, b: &MethodRun<'_>| is_network_of_another_seed(a.record, b.record) && data(a) != data(b);
    if !runs.iter().enumerate().any(|(at, a)| runs.iter().skip(at + 1).any(|b| is_apart(a, b))) {
        return None;
    }
    let by_data = grouped(runs.iter().filter_map(|run| Some((data(run)?, run.method_name()))));
    let of_data = |(data, names): (String, Vec<&str>)| format!("{} on {data}", distinct(names).join(", "));
    Some(by_data.into_iter().map(of_data).collect::<Vec<_>>().join("; "))
}

fn weights_of<'a>(metric: &Definition, results: &'a ComparableResults<'a>) -> WeightsOfStores<'a> {
    let mut weights = WeightsOfStores::new();
    for Part { source, .. } in &results.parts {
        let records = source.results.provenance.metrics.iter().filter(|record| record.id == metric.id);
        for hash in records.filter_map(|record| record.weights_sha256.as_deref()) {
            weights.entry(hash).or_default().insert(source.label);
        }
    }
    weights
}
