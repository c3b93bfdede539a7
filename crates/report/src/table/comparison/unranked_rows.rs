//! Measured rows with numbers that are not ranked, because they lack targets or trials.

use atsplat_numeric::{distinct, grouped};

use super::rank::is_ranked;
use crate::plot::Origin;
use crate::table::{Cell, CellIndex, Note, NoteKind, Row, Table};

/// A note for each reason, with the rows; after a row the columns, unless it is ranked in none. What lacks a score alone, and a busy
/// machine, have notes of their own, and a number that no other is compared with needs none.
pub(super) fn notes_on_rows(table: &Table, one_ranking: bool) -> Vec<Note> {
    let mut named: Vec<(&'static str, String)> = Vec::new();
    for row in table.rows.iter().filter(|row| row.origin == Origin::Measured && is_ranked(row)) {
        let columns = reasons_by_column(table, row, one_ranking);
        for why in distinct(columns.iter().filter_map(|(_, why)| *why)) {
            let of_reason = columns.iter().filter(|(_, reason)| *reason == Some(why));
            let headings: Vec<String> = of_reason.map(|(index, _)| table.heading(*index)).collect();
            let name = row.printed_name();
            let is_everywhere = headings.len() == columns.len();
            named.push((why, if is_everywhere { name } else { format!("{name} ({})", headings.join(", ")) }));
        }
    }
    let text = |(why, rows): (&str, Vec<String>)| format!("not ranked, because {why}: {}", rows.join("; "));
    grouped(named).into_iter().map(|reason| Note { kind: NoteKind::Unranked, text: text(reason) }).collect()
}

/// The columns in which a row has a number beside others, each with why it is not ranked there.
fn reasons_by_column(table: &Table, row: &Row, one_ranking: bool) -> Vec<(CellIndex, Option<&'static str>)> {
    let competes = |row: &&Row| (one_ranking || row.origin == Origin::Measured) && is_ranked(row);
    let has_others = |index: CellIndex| {
        let rows = table.rows.iter().filter(competes);
        rows.filter(|row| row.cell(index).value.number().is_some()).nth(1).is_some()
    };
    let shown = table.columns().filter(|(_, column)| column.direction.is_some()).map(|(index, _)| index);
    let shown = shown.filter(|index| row.cell(*index).value.number().is_some() && has_others(*index));
    // A trial that failed has neither scores nor Gaussians.
    let of_targets = row.cells.iter().flatten().find_map(targets_without_score);
    let of_trials = of_targets.unwrap_or("the method failed on trials, or does not support them");
    let why = |cell: &Cell| targets_without_score(cell).or_else(|| cell.lacks_trials.then_some(of_trials));
    shown.map(|index| (index, why(row.cell(index)))).collect()
}

/// Why targets of a mean have no score, other than that it was not computed.
fn targets_without_score(cell: &Cell) -> Option<&'static str> {
    let counts = cell.counts?;
    if counts.failed > 0 {
        Some("targets failed")
    } else if counts.not_applicable > 0 {
        Some("the method does not support all trials")
    } else {
        (counts.non_finite > 0).then_some("renders are not finite")
    }
}
