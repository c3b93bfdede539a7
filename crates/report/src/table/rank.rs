use std::cmp::Ordering;
use std::collections::BTreeMap;

use atsplat_metrics::{Definition, Direction, Measure};

use super::{Cell, Column, Mark, Note, NoteKind, Place, Row, Table};
use crate::definition::{Marks, Quantity};
use crate::plot::Origin;

/// Marks the best and the second of each column by the printed values, so that equal values share a mark; returns notes on
/// columns whose measured values do not compare.
///
/// If measured numbers are of the published setting, all rows are ranked together, otherwise published and measured rows
/// separately; times always, because published ones are of other machines. Untrained rows, rows without leaked targets, and
/// means that lack targets or trials are not ranked, nor are measured rows of a column that differ in their targets, in the learned
/// weights of its metric, or in the machine or device of their times, or would be in another order with renders that are identical to
/// the truth or without targets that are context frames. Weights that are not the published ones give a ranking of their
/// own. A second place shared by more than two rows is not marked.
pub(super) fn rank(table: &mut Table, marks: Marks, one_ranking: bool) -> Vec<Note> {
    if marks == Marks::None {
        return Vec::new();
    }
    let directed: Vec<(Place, Direction)> =
        table.columns().filter_map(|(place, column)| Some((place, column.direction?))).collect();
    let mut unranked: BTreeMap<Incomparable, Vec<String>> = BTreeMap::new();
    let published = |row: &Row| row.origin == Origin::Published;
    let measured = |row: &Row| row.origin == Origin::Measured;
    for (place, direction) in directed {
        let is_time = table.column(place).quantity == Quantity::Seconds;
        // The mean of several trainings compares if these do.
        let rows: Vec<usize> = printed(table, place, &measured).into_iter().map(|(at, _)| at).collect();
        let rows: Vec<usize> = rows.into_iter().filter(|at| !table.rows[*at].is_over_trainings()).collect();
        let cells: Vec<&Cell> = rows.iter().map(|at| table.rows[*at].cell(place)).collect();
        // The same row without leaked targets follows it, if it has any.
        let without_leaked = |at: usize| {
            let next = table.rows.get(at + 1).filter(|row| row.without_leaked)?.cell(place);
            next.value.number().map(|_| next)
        };
        let others: Vec<&Cell> = rows.iter().zip(&cells).map(|(at, own)| without_leaked(*at).unwrap_or(own)).collect();
        let rankings: &[&dyn Fn(&Row) -> bool] = if let Some(why) = incomparable(&cells, &others, direction) {
            unranked.entry(why).or_default().push(table.heading(place));
            &[&published]
        } else if one_ranking && !is_time && has_published_weights(table.column(place), &cells) {
            &[&|_| true]
        } else {
            &[&published, &measured]
        };
        for included in rankings {
            rank_column(table, place, direction, marks, included);
        }
    }
    let note = |(why, columns): (Incomparable, Vec<String>)| {
        let why = match why {
            Incomparable::Targets => "rows are over different scenes or targets",
            Incomparable::Identical => {
                "renders that are identical to the truth, which means leave out, would change the order"
            }
            Incomparable::Leaked => "the order without targets that are context frames is another one",
            Incomparable::Weights => "metrics have different weights",
            Incomparable::Machines => "times are of different machines or devices",
        };
        let text = format!("no measured number is marked as best, because {why}: {}", columns.join(", "));
        Note { kind: NoteKind::Unranked, text }
    };
    unranked.into_iter().map(note).collect()
}

/// Why the measured values of a column do not compare.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum Incomparable {
    /// Other targets or trials.
    Targets,
    /// Without the renders that are identical to the truth, the order is another one: a method would lose by its best targets.
    Identical,
    /// Without targets that are context frames, the order is another one: a copy of one scores tens of decibels more than any view.
    Leaked,
    /// Other learned weights of the metric.
    Weights,
    /// Times of another machine or device.
    Machines,
}

/// `others` are the cells without leaked targets.
fn incomparable(cells: &[&Cell], others: &[&Cell], direction: Direction) -> Option<Incomparable> {
    if differ(cells.iter().map(|cell| cell.set_hash)) {
        return Some(Incomparable::Targets);
    }
    let order = |cells: &[&Cell], value: &dyn Fn(&Cell) -> Option<f64>| {
        let mut order: Vec<(usize, f64)> =
            cells.iter().enumerate().filter_map(|(at, cell)| Some((at, value(cell)?))).collect();
        order.sort_by(|(_, a), (_, b)| in_direction(direction, *a, *b));
        order.into_iter().map(|(at, _)| at).collect::<Vec<_>>()
    };
    let own = |cell: &Cell| cell.value.number();
    if order(cells, &own) != order(cells, &|cell| cell.with_identical.or_else(|| own(cell))) {
        return Some(Incomparable::Identical);
    }
    if order(cells, &own) != order(others, &own) {
        return Some(Incomparable::Leaked);
    }
    if differ(cells.iter().map(|cell| &cell.metric_weights)) {
        return Some(Incomparable::Weights);
    }
    let machines = cells.iter().map(|cell| cell.timing.as_ref().map(|timing| (&timing.machine, &timing.device)));
    differ(machines).then_some(Incomparable::Machines)
}

/// The better value first.
fn in_direction(direction: Direction, a: f64, b: f64) -> Ordering {
    match direction {
        Direction::Higher => b.total_cmp(&a),
        Direction::Lower => a.total_cmp(&b),
    }
}

fn differ<T: PartialEq>(mut values: impl Iterator<Item = T>) -> bool {
    let first = values.next();
    !values.all(|value| Some(value) == first)
}

/// Whether no cell has a metric whose learned weights are known not to be the published ones.
fn has_published_weights(column: &Column, cells: &[&Cell]) -> bool {
    let Quantity::Metric(Definition { measure: Measure::Perceptual { network, .. }, .. }) = column.quantity else {
        return true;
    };
    let mut weights = cells.iter().filter_map(|cell| cell.metric_weights.as_deref());
    weights.all(|sha256| network.is_published(sha256) != Some(false))
}

/// The printed values of a column that may be ranked, with the positions of their rows.
fn printed(table: &Table, place: Place, included: &dyn Fn(&Row) -> bool) -> Vec<(usize, f64)> {
    let ranked = |row: &Row| included(row) && !row.untrained && !row.without_leaked;
    let rows = table.rows.iter().enumerate().filter(|(_, row)| ranked(row));
    rows.filter_map(|(at, row)| Some((at, printed_value(table, row, place)?))).collect()
}

fn rank_column(table: &mut Table, place: Place, direction: Direction, marks: Marks, included: &dyn Fn(&Row) -> bool) {
    let mut printed = printed(table, place, included);
    // A single value is not ranked.
    if printed.len() < 2 {
        return;
    }
    printed.sort_by(|(_, a), (_, b)| in_direction(direction, *a, *b));
    let mut distinct: Vec<f64> = printed.iter().map(|(_, value)| *value).collect();
    distinct.dedup_by(|a, b| a.total_cmp(b) == Ordering::Equal);
    let holders = |rank: usize| -> Vec<usize> {
        let Some(at_rank) = distinct.get(rank) else { return Vec::new() };
        printed.iter().filter(|(_, value)| value.total_cmp(at_rank) == Ordering::Equal).map(|(at, _)| *at).collect()
    };
    let (best, second) = (holders(0), holders(1));
    if best.len() == printed.len() {
        return;
    }
    let seconds =
        if marks == Marks::BestAndSecond && second.len() <= 2 && printed.len() > 2 { second } else { Vec::new() };
    for (rows, mark) in [(best, Mark::Best), (seconds, Mark::Second)] {
        for at in rows {
            table.rows[at].cells[place.0][place.1].mark = mark;
        }
    }
}

/// The number as printed; counts truncated to thousands are compared as such.
fn printed_value(table: &Table, row: &Row, place: Place) -> Option<f64> {
    let cell = row.cell(place);
    let value = cell.value.number().filter(|_| cell.is_rankable())?;
    let text = table.column(place).format(value);
    match text.strip_suffix('K') {
        Some(thousands) => thousands.parse::<f64>().ok().map(|value| value * 1000.0),
        None => text.parse().ok(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::definition::TableDefinition;

    #[test]
    fn weights_of_another_hash_are_not_the_published_ones() {
        let definition = TableDefinition::named("re10k").unwrap();
        let table = super::super::build::table(&definition, &[], None);
        let (_, column) = table.columns().find(|(_, column)| column.title == "LPIPS").unwrap();
        let cell = |hash: Option<&str>| Cell { metric_weights: hash.map(str::to_owned), ..Cell::default() };
        let of = |hashes: [Option<&str>; 2]| {
            let cells = hashes.map(cell);
            has_published_weights(column, &[&cells[0], &cells[1]])
        };
        let published = Some("397923af8e79cdbb");
        assert_eq!([of([published; 2]), of([published, None]), of([published, Some("01")])], [true, true, false]);
    }
}
