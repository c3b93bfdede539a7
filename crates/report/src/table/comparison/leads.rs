//! Leads of the best measured row of a column over the next that the scenes do not decide.

use atsplat_results::statistics::{Leaked, MIN_SCENES};

use super::difference::{Difference, difference, metric_over_all, why_without_difference};
use super::rank::{in_direction, rankable_rows};
use crate::definition::{Marks, TableDefinition};
use crate::table::selection::ComparableResults;
use crate::table::{CellIndex, Column, Note, NoteKind, Row, Table};

/// A note on the metrics in which the best measured row may be no better than the next; `None` in a table that marks no best.
pub(in crate::table) fn undecided_leads(
    table: &Table,
    definition: &TableDefinition,
    results: &ComparableResults<'_>,
) -> Option<Note> {
    if definition.marks == Marks::None {
        return None;
    }
    let undecided = table.columns().filter_map(|(index, column)| {
        let interval = lead(table, definition, results, index, column)?.interval;
        let is_decided = interval.is_some_and(|[low, high]| low > 0.0 || high < 0.0);
        (!is_decided).then(|| table.heading(index))
    });
    let columns: Vec<String> = undecided.collect();
    (!columns.is_empty()).then(|| Note {
        kind: NoteKind::Paired,
        text: format!(
            "the lead of the best measured row over the next is undecided (the paired 95 % interval over scenes contains 0, or \
             needs {MIN_SCENES} scenes): {}",
            columns.join(", ")
        ),
    })
}

/// The difference between the best two measured rows, marked or not: they may print the same number, or a published one may be better.
/// `None` where they have the same mean or do not compare, and for what is not a metric over all targets.
fn lead(
    table: &Table,
    definition: &TableDefinition,
    results: &ComparableResults<'_>,
    index: CellIndex,
    column: &Column,
) -> Option<Difference> {
    let metric = metric_over_all(definition, index.group, column)?;
    if !table.why_unranked(&[index]).is_empty() {
        return None;
    }
    let measured = rankable_rows(table, index).into_iter().filter_map(|at| {
        let row = table.rows.get(at)?;
        Some((row, row.cell(index).value.number()?))
    });
    let mut measured: Vec<(&Row, f64)> = measured.collect();
    measured.sort_by(|(_, a), (_, b)| in_direction(metric.direction, *a, *b));
    let [(best, first), (next, second), ..] = measured.as_slice() else { return None };
    let is_lead = in_direction(metric.direction, *first, *second).is_lt();
    if !is_lead || [best, next].into_iter().any(|row| why_without_difference(row.cell(index)).is_some()) {
        return None;
    }
    let [best, next] = [best, next].map(|row| results.runs_of_group(row, index.group));
    difference([best.as_slice(), next.as_slice()], metric, Leaked::Included)
}
