//! Paired differences of measured rows to a chosen method.

use atsplat_metrics::Definition;
use atsplat_protocol::Aggregation;
use atsplat_results::statistics::{
    Leaked, MIN_SCENES, Paired, Seeds, common_scene_means, difference_of_seeds, paired_between,
};

use super::comparable::{ComparableResults, MethodRun, Part};
use super::labels::name;
use super::leads::undecided_leads;
use super::measure::weights_of;
use super::{Cell, CellIndex, Column, Counts, Group, Note, NoteKind, Row, Table, Value, has_trials};
use crate::counted;
use crate::definition::{Quantity, TableDefinition, is_called};

/// The mean difference of a metric over the targets that two methods have in common, first minus second, as their protocol averages.
#[derive(Clone, Copy, Debug)]
pub(super) struct Difference {
    pub(super) value: f64,
    /// Its paired 95 % interval over scenes, and over trainings where there are several; `None` with too few scenes.
    pub(super) interval: Option<[f64; 2]>,
    pub(super) scenes: u64,
    targets: u64,
    /// Targets that only one of the two has; 0 where there are several trainings.
    unpaired: u64,
}

/// The difference between two methods, each given by its trainings. `None` without a target in common.
pub(super) fn difference(
    trainings: [&[MethodRun<'_>]; 2],
    metric: &'static Definition,
    leaked: Leaked,
) -> Option<Difference> {
    let [one, other] = trainings;
    let aggregations = trainings.into_iter().flatten().map(|run| run.part.protocol.aggregation);
    // Protocols disagree only in a table that was forced.
    let aggregation = Aggregation::common(aggregations).unwrap_or(Aggregation::SceneMeans);
    if let ([first], [second]) = (one, other) {
        let [a, b] = [first, second].map(|run| (run.results(), run.query(metric, leaked)));
        let Paired { difference, interval, scenes, targets, unpaired, .. } =
            paired_between((a.0, &a.1), (b.0, &b.1), aggregation)?;
        return Some(Difference { value: difference, interval, scenes, targets, unpaired });
    }
    let all = one.iter().chain(other);
    let queries: Vec<_> = all.map(|run| (run.results(), run.query(metric, leaked))).collect();
    let mut means = common_scene_means(&queries, aggregation);
    let targets = means.first().map_or(0, |scenes| scenes.iter().map(|scene| scene.targets).sum());
    let means_of_other = means.split_off(one.len());
    let Seeds { mean, interval, scenes, .. } = difference_of_seeds(&means, &means_of_other)?;
    Some(Difference { value: mean, interval, scenes, targets, unpaired: 0 })
}

/// Adds the differences to the chosen method, if there is one; returns notes on these, and on undecided leads.
pub(super) fn paired(table: &mut Table, definition: &TableDefinition, results: &ComparableResults<'_>) -> Vec<Note> {
    let undecided = undecided_leads(table, definition, results);
    let differences = match definition.choice.against.as_deref() {
        Some(against) => add_differences(table, definition, Reference { results, against }),
        None => Vec::new(),
    };
    undecided.into_iter().chain(differences).collect()
}

/// A column of a table whose metric is over all targets.
#[derive(Clone, Copy)]
struct Compared {
    index: CellIndex,
    metric: &'static Definition,
}

/// Adds the paired differences to a method as the last group of columns: of the first metric of every group over all targets, or of
/// all its metrics if columns were chosen. Returns notes on them.
fn add_differences(table: &mut Table, definition: &TableDefinition, reference: Reference<'_>) -> Vec<Note> {
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
            });
        }
    }
    let Reference { against, .. } = reference;
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
        let unpaired = found.iter().filter_map(|found| found.as_ref().ok()?.map(|found| found.unpaired)).max();
        if let Some(unpaired) = unpaired.filter(|unpaired| *unpaired > 0) {
            let (name, targets) = (name(row), counted(unpaired, "target"));
            let text = format!("{name}: {targets} that only it or {against} has, not in the difference");
            notes.push(Note { kind: NoteKind::Counts, text });
        }
        row.cells.push(found.into_iter().map(cell).collect());
    }
    let title = format!("paired difference to {against}");
    table.groups.push(Group { title, preset: None, measured_on: None, columns });
    notes
}

/// The metric of a column, if it is over all targets of a protocol; the average over bins is taken for it.
pub(super) fn metric_over_all(
    definition: &TableDefinition,
    group: usize,
    column: &Column,
) -> Option<&'static Definition> {
    let group = definition.groups.get(group).filter(|group| group.distances.is_none())?;
    let is_bin = group.bin.as_deref().is_some_and(|bin| bin != "average");
    match column.quantity {
        Quantity::Metric(metric) if !is_bin => Some(metric),
        _ => None,
    }
}

/// Why a difference over all targets is none of the numbers in a column: they were not computed, or lack targets outside all bins.
pub(super) fn why_without_difference(cell: &Cell) -> Option<String> {
    if let (Value::Absent, Some(why)) = (&cell.value, &cell.not_computed) {
        return Some(why.clone());
    }
    let is_outside = cell.counts.is_some_and(|counts| counts.outside_bins > 0);
    is_outside.then(|| "some targets are outside all bins of overlap".to_owned())
}

fn cell(found: Result<Option<Difference>, String>) -> Cell {
    match found {
        Ok(Some(Difference { value, interval, scenes, targets, .. })) => Cell {
            value: Value::Number(value),
            interval,
            counts: Some(Counts { scenes, targets, ..Counts::default() }),
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
    fn difference(self, row: &Row, compared: Compared) -> Result<Option<Difference>, String> {
        let Compared { index, metric } = compared;
        let cell = row.cell(index);
        // Means over trainings have no numbers by bin of overlap.
        if row.is_over_trainings() && cell.value == Value::Absent {
            return Ok(None);
        }
        let runs = self.results.runs(row, index.group);
        let Some(first) = runs.first() else { return Ok(None) };
        let reference = self.run(*first)?;
        let is_reference = |run: &MethodRun<'_>| {
            run.part.source.label == reference.part.source.label
                && (run.preset_name(), run.method()) == (reference.preset_name(), reference.method())
        };
        if runs.iter().any(is_reference) {
            return Ok(None);
        }
        if let Some(why) = why_without_difference(cell) {
            return Err(why);
        }
        let against = self.against;
        let weights = |run: MethodRun<'_>| weights_of(run.results(), metric.id);
        if let (Some(one), Some(other)) = (weights(*first), weights(reference))
            && one != other
        {
            return Err(format!("the weights of {} are not those of {against}", metric.name));
        }
        let leaked = if row.without_leaked { Leaked::Excluded } else { Leaked::Included };
        let found = difference([runs.as_slice(), &[reference]], metric, leaked)
            .ok_or_else(|| format!("no target has {} of both the row and {against}", metric.name))?;
        if found.scenes < MIN_SCENES {
            let scenes = counted(found.scenes, "scene");
            return Err(format!("{scenes} in common with {against}, fewer than {MIN_SCENES}"));
        }
        Ok(Some(found))
    }

    /// The results of the reference under the protocol of a run and over its data: those of the run's own store, or else of the first
    /// store that has any.
    fn run(self, run: MethodRun<'_>) -> Result<MethodRun<'a>, String> {
        let (against, preset) = (self.against, run.part.preset.published());
        let parts = self.results.parts.iter().filter(|part| part.preset.published() == preset);
        let mut found: Vec<MethodRun<'a>> = parts.filter_map(|part| run_called(part, against)).collect();
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

/// The results of the method that is called so.
fn run_called<'a>(part: &'a Part<'a>, name: &str) -> Option<MethodRun<'a>> {
    let (results, store) = (part.source.results, part.source.label);
    let mut records = results.provenance.methods.iter();
    let record = records
        .find(|record| is_called(store, record, name) && has_trials(results, &part.preset.name, &record.name))?;
    Some(MethodRun { part, record })
}

impl<'a> ComparableResults<'a> {
    /// What was measured for a group of columns of a row: one method, or every training.
    pub(super) fn runs(&'a self, row: &Row, group: usize) -> Vec<MethodRun<'a>> {
        let measured = row.measured(group).into_iter();
        let run = measured.filter_map(|protocol| {
            let part = self.parts.iter().find(|part| part.is(protocol))?;
            Some(MethodRun { part, record: part.source.results.provenance.method(&protocol.method)? })
        });
        run.collect()
    }
}
