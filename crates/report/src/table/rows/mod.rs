//! The rows of a table: the published ones, and what each measured row was measured on, with its numbers and remarks.
//! Rows follow the published rows that they reproduce; several trainings of one network have a mean too.

mod measure;
mod measured_on;
#[cfg(test)]
mod measured_on_tests;
mod measured_row;
mod remarks;
#[cfg(test)]
mod tests;
#[cfg(test)]
mod times_tests;
mod trainings;
#[cfg(test)]
mod trainings_tests;

pub(super) use measure::weights_of;
pub use measured_on::MeasuredOn;
pub(crate) use remarks::{INFERENCE_ONLY, LEAKED_EXCLUDED};

use super::selection::{ComparableResults, StoreMethod};
use super::{Cell, Row, Value};
use crate::definition::{PublishedRow, RowDefinition, TableDefinition, is_ablation};
use crate::plot::Origin;
use measured_row::{Reproduced, RowSource};
use trainings::{distinguish, mean_rows};

/// Published rows, each followed by the measured rows that reproduce it; then those of the other methods.
pub(super) fn rows(
    definition: &TableDefinition,
    published: &[PublishedRow],
    results: Option<&ComparableResults<'_>>,
) -> Vec<Row> {
    let mut list = RowList::default();
    let mut used: Vec<StoreMethod<'_>> = Vec::new();
    for (position, row) in published.iter().enumerate() {
        let known = definition.row(&row.labels);
        list.rows.push(published_row(row, position, known));
        let Some((results, known)) = results.zip(known) else { continue };
        let methods = methods(definition, results, known);
        used.extend(methods.iter().flatten());
        let reproduced = Some(Reproduced { position, row, definition: known });
        let sources = methods.into_iter().map(|method| RowSource { definition, results, reproduced, method });
        list.add_measured(definition, results, sources);
    }
    if let Some(results) = results.filter(|_| definition.others) {
        let first = list.rows.len();
        let others = results
            .store_methods()
            .into_iter()
            .filter(|method| !used.iter().any(|known| known.is(*method)))
            .filter(|method| definition.ablations || !is_ablation(method.record))
            .map(|method| RowSource { definition, results, reproduced: None, method: Some(method) });
        list.add_measured(definition, results, others);
        if let Some(row) = list.rows.get_mut(first) {
            row.rule_above = true;
        }
    }
    distinguish(&mut list.rows, &list.means);
    list.rows
}

/// The rows of a table so far.
#[derive(Default)]
struct RowList {
    rows: Vec<Row>,
    /// Positions of the means over trainings, each with the names of the trainings.
    means: Vec<(usize, String)>,
}

impl RowList {
    /// Adds measured rows, then the means over those of them that are trainings of one network.
    fn add_measured<'a>(
        &mut self,
        definition: &TableDefinition,
        results: &ComparableResults<'_>,
        sources: impl Iterator<Item = RowSource<'a>>,
    ) {
        let first = self.rows.len();
        self.rows.extend(sources.flat_map(RowSource::rows));
        for (row, trainings) in mean_rows(definition, results, &self.rows[first..]) {
            self.means.push((self.rows.len(), trainings));
            self.rows.push(row);
        }
    }
}

/// The methods that reproduce a row; a single `None` if each group has its own method.
fn methods<'a>(
    definition: &TableDefinition,
    results: &'a ComparableResults<'a>,
    row: &RowDefinition,
) -> Vec<Option<StoreMethod<'a>>> {
    if definition.groups.iter().filter(|group| group.method.is_some()).count() > 1 {
        return vec![None];
    }
    let rule = row.method.as_ref().or_else(|| definition.groups.iter().find_map(|group| group.method.as_ref()));
    let Some(rule) = rule else { return Vec::new() };
    results.store_methods().into_iter().filter(|method| rule.accepts(method.record)).map(Some).collect()
}

fn published_row(row: &PublishedRow, position: usize, known: Option<&RowDefinition>) -> Row {
    let cell = |value: &Value| Cell { value: value.clone(), published: true, ..Cell::default() };
    Row {
        labels: row.labels.clone(),
        origin: Origin::Published,
        published_row: Some(position),
        measured_on: None,
        remarks: Vec::new(),
        method: None,
        store: None,
        protocols: Vec::new(),
        trainings: Vec::new(),
        untrained: false,
        inference_only: false,
        not_retrained: false,
        without_leaked: false,
        rule_above: known.is_some_and(|known| known.rule_above),
        cells: row.values.iter().map(|values| values.iter().map(cell).collect()).collect(),
    }
}
