use std::cmp::Ordering;

use atsplat_metrics::Direction;

use super::{Mark, Place, Row, Table};
use crate::definition::Marks;
use crate::plot::Origin;

/// Marks the best and the second of each column by the printed values, so that equal values share a mark.
///
/// If measured numbers are of the published setting, all rows are ranked together, otherwise published and measured rows
/// separately. Untrained rows, rows without leaked targets, and means that lack failed targets or trials are not ranked. A
/// second place shared by more than two rows is not marked.
pub(super) fn rank(table: &mut Table, marks: Marks, one_ranking: bool) {
    if marks == Marks::None {
        return;
    }
    let directed: Vec<(Place, Direction)> =
        table.columns().filter_map(|(place, column)| Some((place, column.direction?))).collect();
    for (place, direction) in directed {
        let rankings: &[&dyn Fn(&Row) -> bool] = if one_ranking {
            &[&|_| true]
        } else {
            &[&|row| row.origin == Origin::Published, &|row| row.origin == Origin::Measured]
        };
        for included in rankings {
            rank_column(table, place, direction, marks, included);
        }
    }
}

fn rank_column(table: &mut Table, place: Place, direction: Direction, marks: Marks, included: &dyn Fn(&Row) -> bool) {
    let ranked = |row: &Row| included(row) && !row.untrained && !row.without_leaked;
    let mut printed: Vec<(usize, f64)> = Vec::new();
    for (at, row) in table.rows.iter().enumerate().filter(|(_, row)| ranked(row)) {
        if let Some(value) = printed_value(table, row, place) {
            printed.push((at, value));
        }
    }
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
