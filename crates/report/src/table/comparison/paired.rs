//! Paired differences of measured rows to a chosen method.

use atsplat_metrics::Definition;
use atsplat_results::statistics::{Leaked, MIN_SCENES};

use super::difference::{Difference, differ_in_weights, difference, metric_over_all, why_without_difference};
use crate::counted;
use crate::definition::{Quantity, TableDefinition, is_called};
use crate::table::selection::{ComparableResults, MethodRun, Part};
use crate::table::{Cell, CellDifference, CellIndex, Column, Counts, Group, Note, NoteKind, Row, Table, Value};

/// A column of a table whose metric is over all targets.
#[derive(Clone, Copy)]
struct Compared {
    index: CellIndex,
    metric: &'static Definition,
}

/// Adds the paired differences to the chosen method, if there is one, as the last group of columns: of the first metric of every group
/// over all targets, or of all its metrics if columns were chosen. Returns notes on them.
pub(in crate::table) fn add_differences(
    table: &mut Table,
    definition: &TableDefinition,
    results: &ComparableResults<'_>,
) -> Vec<Note> {
    let Some(against) = definition.choice.against.as_deref() else { return Vec::new() };
    let reference = Reference { results, against };
    let (mut compared, mut columns) = (Vec::new(), Vec::new());
    for (group, Group { title, columns: of_group, .. }) in table.groups.iter().enumerate() {
        let metrics = of_group.iter().enumerate().filter_map(|(at, column)| {
            let metric = metric_over_all(definition, group, column)?;
            Some((column, Compared { index: CellIndex { group, column: at }, metric }))
        });
        let most = if definition.choice.columns.is_empty() { 1 } else { usize::MAX };
        for (column, of_column) in metrics.take(most) {
            compared.push(of_column);
            columns.push(Column {
                name: format!("{}_difference", column.name),
                title: format!("Δ{}{}{title}", column.title, if title.is_empty() { "" } else { ", " }),
                quantity: Quantity::Difference(of_column.metric),
                direction: None,
                exact: false,
                intervals: true,
                decimals: column.decimals,
            });
        }
    }
    if columns.is_empty() {
        let text = format!("no difference to {against}: no column is a metric over all targets");
        return vec![Note { kind: NoteKind::Paired, text }];
    }
    let text = format!(
        "Δ: the row minus {against}, over the targets that both have, averaged as the protocol does, with its paired 95 % interval \
         over scenes"
    );
    let mut notes = vec![Note { kind: NoteKind::Paired, text }];
    for row in &mut table.rows {
        let found: Vec<_> = compared.iter().map(|compared| reference.difference(row, *compared)).collect();
        let unpaired = found.iter().filter_map(|found| Some(found.as_ref().ok()?.as_ref()?.0.unpaired)).max();
        if let Some(unpaired) = unpaired.filter(|unpaired| *unpaired > 0) {
            let (name, targets) = (row.printed_name(), counted(unpaired, "target"));
            let which = if row.is_over_trainings() {
                format!("that not all of its trainings and {against} have")
            } else {
                format!("that only it or {against} has")
            };
            let text = format!("{name}: {targets} {which}, not in the difference");
            notes.push(Note { kind: NoteKind::Counts, text });
        }
        let cells = found.into_iter().zip(&compared).map(|(found, compared)| Cell {
            metric_weights: row.cell(compared.index).metric_weights.clone(),
            ..cell(found)
        });
        let cells: Vec<Cell> = cells.collect();
        row.cells.push(cells);
    }
    let title = format!("paired difference to {against}");
    table.groups.push(Group { title, preset: None, measured_on: None, columns });
    notes
}

/// A difference, and what it is between.
type Found = (Difference, CellDifference);

fn cell(found: Result<Option<Found>, String>) -> Cell {
    match found {
        Ok(Some((Difference { value, interval, scenes, targets, .. }, difference))) => Cell {
            value: Value::Number(value),
            interval,
            counts: Some(Counts { scenes, targets, ..Counts::default() }),
            difference: Some(Box::new(difference)),
            ..Cell::default()
        },
        Ok(None) => Cell::default(),
        Err(reason) => Cell { not_computed: Some(reason), ..Cell::default() },
    }
}

/// The method that rows are compared with.
#[derive(Clone, Copy)]
struct Reference<'a> {
    results: &'a ComparableResults<'a>,
    against: &'a str,
}

impl<'a> Reference<'a> {
    /// The difference of a row; `None` for its own row, and for what was not measured.
    ///
    /// # Errors
    /// Why the difference cannot be computed.
    fn difference(self, row: &Row, compared: Compared) -> Result<Option<Found>, String> {
        let Compared { index, metric } = compared;
        let cell = row.cell(index);
        // Means over trainings have no numbers by bin of overlap, without a reason.
        if row.is_over_trainings() && cell.value == Value::Absent && cell.not_computed.is_none() {
            return Ok(None);
        }
        let runs = self.results.runs_of_group(row, index.group);
        let Some(first) = runs.first() else { return Ok(None) };
        let reference = self.run(*first)?;
        let is_reference = |run: &MethodRun<'_>| {
            run.part.source.label == reference.part.source.label
                && (run.preset_name(), run.method_name()) == (reference.preset_name(), reference.method_name())
        };
        if runs.iter().any(is_reference) {
            return Ok(None);
        }
        if let Some(why) = why_without_difference(cell) {
            return Err(why);
        }
        let against = self.against;
        if differ_in_weights(runs.iter().copied().chain([reference]), metric) {
            return Err(format!("the weights of {} are not those of {against}", metric.name));
        }
        let leaked = if row.without_leaked { Leaked::Excluded } else { Leaked::Included };
        let found = difference([runs.as_slice(), &[reference]], metric, leaked)
            .ok_or_else(|| format!("no target has {} of both the row and {against}", metric.name))?;
        if found.scenes < MIN_SCENES {
            let scenes = counted(found.scenes, "scene");
            return Err(format!("{scenes} in common with {against}, fewer than {MIN_SCENES}"));
        }
        let between = CellDifference {
            row: row.measured(index.group).into_iter().cloned().collect(),
            reference: reference.store_protocol(self.results.remarks(reference)),
        };
        Ok(Some((found, between)))
    }

    /// The results of the reference under the protocol of a run and over its data: those of the run's own store, or else of the first
    /// store that has any.
    fn run(self, run: MethodRun<'_>) -> Result<MethodRun<'a>, String> {
        let (against, preset) = (self.against, run.part.preset.published());
        let parts = self.results.parts.iter().filter(|part| part.preset.published() == preset);
        let called = |part: &'a Part<'a>| part.first_run(|record| is_called(part.source.label, record, against));
        let mut found: Vec<MethodRun<'a>> = parts.filter_map(called).collect();
        found.sort_by_key(|other| other.part.source.label != run.part.source.label);
        let comparable = found.iter().find(|other| other.part.is_comparable_with(run.part));
        comparable.copied().ok_or_else(|| {
            if found.is_empty() {
                format!("{against} has no results on these data under {}", run.preset_name())
            } else {
                format!("the results of {against} are of another protocol, index or data")
            }
        })
    }
}
