//! The tables of a definition: the steps that fill one, in order.

use atsplat_numeric::distinct;

use super::comparison::{add_differences, rank, undecided_leads};
use super::footer::footer;
use super::published::{differences_to_reference, orders};
use super::rows::rows;
use super::selection::{ComparableResults, comparable_groups};
use super::{Column, Group, Row, Source, Table};
use crate::ReportError;
use crate::definition::{ColumnDefinition, ColumnGroup, PublishedRow, TableDefinition};
use crate::plot::Origin;

/// How results of different protocols are combined.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Mixing {
    /// Each protocol gets its own table.
    #[default]
    Apart,
    /// They share one table, which says so.
    Forced,
}

/// The tables of a definition: one per protocol that was run, or the published numbers alone.
///
/// # Errors
/// [`ReportError::Csv`] or [`ReportError::Definition`] if the published numbers cannot be read, [`ReportError::Store`]
/// for an invalid protocol in a store.
pub fn tables(definition: &TableDefinition, sources: &[Source<'_>], mixing: Mixing) -> Result<Vec<Table>, ReportError> {
    let published = definition.published()?.rows;
    let groups = comparable_groups(definition, sources, mixing == Mixing::Forced)?;
    let mut tables: Vec<Table> = Vec::new();
    for results in &groups {
        let table = table(definition, &published, Some(results));
        if table.is_measured() {
            tables.push(table);
        }
    }
    if tables.is_empty() {
        tables.push(table(definition, &published, None));
    }
    if tables.len() > 1 {
        for (at, table) in tables.iter_mut().enumerate() {
            table.name = format!("{}-{}", definition.name, at + 1);
        }
    }
    Ok(tables)
}

/// The table of comparable results, or of the published numbers alone.
pub(super) fn table(
    definition: &TableDefinition,
    published: &[PublishedRow],
    results: Option<&ComparableResults<'_>>,
) -> Table {
    let mut rows = rows(definition, published, results);
    if definition.choice.without_published {
        rows.retain(|row| row.origin == Origin::Measured);
    }
    if let Some(results) = results {
        results.sort_by_choice(&mut rows);
    }
    let mut table = Table {
        name: definition.name.clone(),
        title: definition.title.clone(),
        caption: caption(definition, &rows),
        labels: definition.labels.iter().map(|label| label.title.clone()).collect(),
        groups: definition.groups.iter().map(|columns| group(definition, columns, results, &rows)).collect(),
        rows,
        footer: Vec::new(),
        orders: Vec::new(),
        forced: results.is_some_and(|results| results.mixed),
        unranked: Vec::new(),
        to_reference: Vec::new(),
    };
    let is_published = |row: &Row| row.measured_on.as_ref().is_none_or(|on| on.published_setting);
    let one_ranking = results.is_some_and(|results| !results.mixed) && table.rows.iter().all(is_published);
    let unranked = rank(&mut table, definition.marks, one_ranking);
    table.orders = results.map(|results| orders(&table, definition, results)).unwrap_or_default();
    table.to_reference =
        results.map(|results| differences_to_reference(&table, definition, results)).unwrap_or_default();
    let leads = results.and_then(|results| undecided_leads(&table, definition, results));
    let differences = results.map(|results| add_differences(&mut table, definition, results)).unwrap_or_default();
    table.footer = footer(&table, definition, results);
    table.footer.extend(unranked.into_iter().chain(leads).chain(differences));
    table.footer.extend(results.and_then(|results| results.left_out_by_choice(definition)));
    table
}

/// The definition's caption, and what the measured rows were measured on: the sentence that a pasted table keeps.
fn caption(definition: &TableDefinition, rows: &[Row]) -> String {
    /// More places are named in their rows alone.
    const MAX: usize = 2;
    let measured: Vec<&Row> = rows.iter().filter(|row| row.origin == Origin::Measured).collect();
    if measured.is_empty() {
        return definition.caption.clone();
    }
    let on = distinct(measured.iter().filter_map(|row| Some(row.measured_on.as_ref()?.place.as_str())));
    let place = match on.len() {
        0..=MAX => on.join("; "),
        _ => "what the row says".to_owned(),
    };
    let elsewhere = measured.iter().any(|row| row.measured_on.as_ref().is_some_and(|on| !on.published_setting));
    let published = rows.iter().any(|row| row.origin == Origin::Published);
    let comparable = if elsewhere && published { ": not comparable with the paper's numbers" } else { "" };
    format!("{} Measured on {place}{comparable}.", definition.caption)
}

fn group(
    definition: &TableDefinition,
    group: &ColumnGroup,
    results: Option<&ComparableResults<'_>>,
    rows: &[Row],
) -> Group {
    let column = |column: &ColumnDefinition| Column {
        name: TableDefinition::published_name(group, column),
        title: column.title().to_owned(),
        quantity: column.quantity,
        direction: column.quantity.direction(),
        exact: column.exact,
        intervals: definition.intervals,
        decimals: definition.choice.decimals_of(column.quantity),
    };
    Group {
        title: group.title.clone(),
        preset: group.preset.clone(),
        measured_on: results.and_then(|results| results.other_setting(group.preset.as_deref(), rows)),
        columns: group.columns.iter().map(column).collect(),
    }
}
