use std::cmp::Ordering;

use atsplat_metrics::Direction;

use super::{Mark, Note, NoteKind, Place, Row, Table};
use crate::definition::{Marks, Quantity};
use crate::plot::Origin;

/// Marks the best and the second of each column by the printed values, so that equal values share a mark; returns notes on
/// columns whose measured values do not compare.
///
/// If measured numbers are of the published setting, all rows are ranked together, otherwise published and measured rows
/// separately; times always, because published ones are of other machines. Untrained rows, rows without leaked targets, and
/// means that lack targets or trials are not ranked, nor are measured rows of a column that differ in their targets, or in the
/// machine or device of their times. A second place shared by more than two rows is not marked.
pub(super) fn rank(table: &mut Table, marks: Marks, one_ranking: bool) -> Vec<Note> {
    if marks == Marks::None {
        return Vec::new();
    }
    let directed: Vec<(Place, Direction)> =
        table.columns().filter_map(|(place, column)| Some((place, column.direction?))).collect();
    let (mut over_others, mut on_others) = (Vec::new(), Vec::new());
    let published = |row: &Row| row.origin == Origin::Published;
    let measured = |row: &Row| row.origin == Origin::Measured;
    for (place, direction) in directed {
        let is_time = table.column(place).quantity == Quantity::Seconds;
        let rankings: &[&dyn Fn(&Row) -> bool] = if !is_comparable(table, &printed(table, place, &measured), place) {
            let others = if is_time { &mut on_others } else { &mut over_others };
            others.push(table.heading(place));
            &[&published]
        } else if one_ranking && !is_time {
            &[&|_| true]
        } else {
            &[&published, &measured]
        };
        for included in rankings {
            rank_column(table, place, direction, marks, included);
        }
    }
    let notes = [
        (over_others, "rows are over different scenes or targets"),
        (on_others, "times are of different machines or devices"),
    ];
    let note = |(columns, why): (Vec<String>, &str)| Note {
        kind: NoteKind::Unranked,
        text: format!("no measured number is marked as best, because {why}: {}", columns.join(", ")),
    };
    notes.into_iter().filter(|(columns, _)| !columns.is_empty()).map(note).collect()
}

/// Whether measured values of a column are over one set of targets or trials, or were timed on one machine and device.
fn is_comparable(table: &Table, printed: &[(usize, f64)], place: Place) -> bool {
    let mut bases = printed.iter().map(|(at, _)| {
        let cell = table.rows[*at].cell(place);
        (cell.set_hash, cell.timing.as_ref().map(|timing| (&timing.machine, &timing.device)))
    });
    let first = bases.next();
    bases.all(|basis| Some(basis) == first)
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
    printed.sort_by(|(_, a), (_, b)| match direction {
        Direction::Higher => b.total_cmp(a),
        Direction::Lower => a.total_cmp(b),
    });
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
