//! Tables of sample stores, and what tests look up in them.

use atsplat_results::{MethodRecord, Results, TrainingRecord};

use crate::definition::TableDefinition;
use crate::plot::Origin;
use crate::sample::{atsplat, nearest_view, preset, random, results};
use crate::table::{Mixing, NoteKind, Row, Source, Table, protocol_tables, tables};

/// The table of one store.
pub(super) fn table_of(name: &str, results: &Results) -> Table {
    tables_of(name, &[("run", results)], Mixing::Apart).swap_remove(0)
}

/// The table of stores with the labels `one`, `two` and `three`.
pub(super) fn table_of_stores(name: &str, stores: &[&Results]) -> Table {
    let stores: Vec<(&str, &Results)> = ["one", "two", "three"].into_iter().zip(stores.iter().copied()).collect();
    tables_of(name, &stores, Mixing::Apart).swap_remove(0)
}

pub(super) fn tables_of(name: &str, stores: &[(&str, &Results)], mixing: Mixing) -> Vec<Table> {
    let sources: Vec<Source<'_>> = stores.iter().map(|(label, results)| Source { label, results }).collect();
    tables(&TableDefinition::named(name).unwrap(), &sources, mixing).unwrap()
}

pub(super) fn protocols(results: &Results) -> Vec<Table> {
    protocol_tables(&[Source { label: "run", results }], Mixing::Apart).unwrap()
}

pub(super) fn notes(table: &Table, kind: NoteKind) -> Vec<&str> {
    table.footer.iter().filter(|note| note.kind == kind).map(|note| note.text.as_str()).collect()
}

/// The notes of a kind, a line each.
pub(super) fn notes_as_text(table: &Table, kind: NoteKind) -> String {
    notes(table, kind).into_iter().map(|text| format!("{text}\n")).collect()
}

pub(super) fn measured(table: &Table) -> impl Iterator<Item = &Row> {
    table.rows.iter().filter(|row| row.origin == Origin::Measured)
}

pub(super) fn row_of<'a>(table: &'a Table, method: &str) -> &'a Row {
    table.rows.iter().find(|row| row.method.as_deref() == Some(method) && !row.without_leaked).unwrap()
}

/// A network of this name, with weights of its own, that was trained on these data from this seed.
pub(super) fn trained(name: &str, seed: &str, data: &str) -> MethodRecord {
    let training = Some(TrainingRecord { data: data.to_owned(), seed: Some(seed.to_owned()) });
    MethodRecord { weights_sha256: Some(format!("weights of {name}")), training, ..atsplat(name, |_| ()) }
}

/// Every method that a table of the paper has a row for.
pub(super) fn paper_methods() -> Vec<MethodRecord> {
    use atsplat_model::config::{AnchorDesign, Selection};
    let thresholds = |values: [f64; 3]| {
        atsplat(&format!("thresholds {values:?}"), |config| *config = config.with_thresholds(&values).unwrap())
    };
    let k = |k| atsplat(&format!("k {k}"), |config| config.head.gaussians_per_token = k);
    vec![
        atsplat("atsplat", |_| ()),
        random(),
        nearest_view(),
        atsplat("farthest", |config| config.expansion.selection = Selection::FarthestPoint {}),
        atsplat("none", |config| *config = config.with_expansion_in_first(0)),
        atsplat("rays", |config| config.anchors.design = AnchorDesign::RayDepth {}),
        thresholds([0.1, 0.1, 0.4]),
        thresholds([0.01, 0.01, 0.04]),
        k(8),
        k(32),
        trained("joint", "1", "rooms train 0 to 9, yards train 0 to 9"),
    ]
}

/// Stores of the methods `a` and `b` under one preset; `b` is 1 dB better, twice as fast, and has half the Gaussians.
pub(super) fn two_stores(name: &str) -> [Results; 2] {
    let [first, mut second] = ["a", "b"].map(|method| results(vec![preset(name)], vec![atsplat(method, |_| ())]));
    for row in &mut second.targets {
        row.scores.values_mut().for_each(|score| *score += 1.0);
    }
    second.trials.iter_mut().for_each(|trial| trial.gaussians = Some(11_520));
    second.timings.iter_mut().flat_map(|row| &mut row.encode).for_each(|secs| *secs *= 0.5);
    [first, second]
}
