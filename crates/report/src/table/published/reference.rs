//! How the rows of an ablation differ from the full method, which is the definition's reference row.

use super::orders::{paired_difference, reproducing_methods};
use crate::definition::TableDefinition;
use crate::plot::{Estimate, Origin};
use crate::table::selection::ComparableResults;
use crate::table::{CellIndex, Row, Table};

/// For each published row, by its position, the difference of the methods that reproduce it to those that reproduce the reference row,
/// each over all of its trainings: by the first metric of the first group of columns. Rows that do not compare are left out.
pub(in crate::table) fn differences_to_reference(
    table: &Table,
    definition: &TableDefinition,
    results: &ComparableResults<'_>,
) -> Vec<(usize, Estimate)> {
    let published = || table.rows.iter().filter(|row| row.origin == Origin::Published);
    let is_reference = |row: &&Row| definition.reference.as_ref() == Some(&row.labels);
    let is_overall = definition.groups.first().is_some_and(|group| group.targets.is_overall());
    let first_metric = table.columns().find_map(|(index, column)| Some((index, column.quantity.metric()?)));
    let (Some(reference), Some((index @ CellIndex { group: 0, .. }, metric)), true) =
        (published().find(is_reference), first_metric, is_overall)
    else {
        return Vec::new();
    };
    let methods = |row: &Row| reproducing_methods(table, definition, results, row, index);
    let Some(of_reference) = methods(reference) else { return Vec::new() };
    let difference = |row: &Row| {
        let found = paired_difference(results, [&methods(row)?, &of_reference], metric)?;
        Some((row.published_row?, Estimate { value: found.value, interval: found.interval }))
    };
    published().filter(|row| !is_reference(row)).filter_map(difference).collect()
}
