use atsplat_numeric::distinct;

use super::comparable::{ComparableResults, StoreMethod, comparable_groups};
use super::footer::footer;
use super::measured_row::{Reproduced, RowSource};
use super::orders::orders;
use super::paired::paired;
use super::rank::rank;
use super::trainings::{distinguish, mean_rows};
use super::{Cell, Column, Group, Row, Source, Table, Value};
use crate::ReportError;
use crate::definition::{ColumnDefinition, ColumnGroup, PublishedRow, RowDefinition, TableDefinition, is_ablation};
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
    };
    let is_published = |row: &Row| row.measured_on.as_ref().is_none_or(|on| on.published_setting);
    let one_ranking = results.is_some_and(|results| !results.mixed) && table.rows.iter().all(is_published);
    let unranked = rank(&mut table, definition.marks, one_ranking);
    table.orders = results.map(|results| orders(&table, definition, results)).unwrap_or_default();
    let paired = results.map(|results| paired(&mut table, definition, results)).unwrap_or_default();
    table.footer = footer(&table, definition, results);
    table.footer.extend(unranked.into_iter().chain(paired));
    table.footer.extend(results.and_then(|results| results.left_out_by_choice(definition)));
    table
}

/// Published rows, each followed by the measured rows that reproduce it; then those of the other methods.
fn rows(definition: &TableDefinition, published: &[PublishedRow], results: Option<&ComparableResults<'_>>) -> Vec<Row> {
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
    let cell = |value: &Value| Cell { value: value.clone(), ..Cell::default() };
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

/// The definition's caption, and what the measured rows were measured on: the sentence that a pasted table keeps.
fn caption(definition: &TableDefinition, rows: &[Row]) -> String {
    /// More places are named in their rows alone.
    const MOST: usize = 2;
    let measured: Vec<&Row> = rows.iter().filter(|row| row.origin == Origin::Measured).collect();
    if measured.is_empty() {
        return definition.caption.clone();
    }
    let on = distinct(measured.iter().filter_map(|row| Some(row.measured_on.as_ref()?.place.as_str())));
    let place = match on.len() {
        0..=MOST => on.join("; "),
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
    };
    Group {
        title: group.title.clone(),
        preset: group.preset.clone(),
        measured_on: results.and_then(|results| results.other_setting(group.preset.as_deref(), rows)),
        columns: group.columns.iter().map(column).collect(),
    }
}
