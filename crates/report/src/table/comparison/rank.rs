//! Marks of the best and second values of columns, and why some columns have none.

use std::cmp::Ordering;
use std::collections::BTreeMap;

use atsplat_metrics::Direction;

use super::unranked_rows::notes_on_rows;
use crate::definition::{Marks, Quantity};
use crate::plot::Origin;
use crate::table::{Cell, CellIndex, Column, Mark, Note, NoteKind, Row, Table};

/// Marks the best and the second of each column by the printed values, so that equal values share a mark; returns notes on
/// columns whose measured values do not compare, and on rows that lack targets or trials. Why columns do not compare stays in
/// [`Table::unranked`], also for a table without marks.
///
/// If measured numbers are of the published setting, all rows are ranked together, otherwise published and measured rows
/// separately; times always, because published ones are of other machines. Untrained rows, rows without leaked targets, and
/// means that lack targets or trials are not ranked, nor are measured rows of a table that mixes protocols, or of a column that
/// differ in their targets, in the learned weights of its metric, or in the machine or device of their times, or would be in another
/// order with renders that are identical to the truth or without targets that are context frames. Scores with weights that are not
/// the published ones are ranked separately. A second place shared by more than two rows is not marked.
pub(in crate::table) fn rank(table: &mut Table, marks: Marks, one_ranking: bool) -> Vec<Note> {
    let directed: Vec<(CellIndex, Direction)> =
        table.columns().filter_map(|(index, column)| Some((index, column.direction?))).collect();
    let published = |row: &Row| row.origin == Origin::Published;
    let measured = |row: &Row| row.origin == Origin::Measured;
    let mut unranked: Vec<(CellIndex, Incomparable)> = Vec::new();
    for (index, direction) in directed {
        let why = why_incomparable(table, index, direction);
        let rankings: &[&dyn Fn(&Row) -> bool] = if let Some(why) = why {
            unranked.push((index, why));
            &[&published]
        } else if one_ranking && has_one_ranking(table, index) {
            &[&|_| true]
        } else {
            &[&published, &measured]
        };
        for included in rankings {
            rank_column(table, index, direction, marks, included);
        }
    }
    let mut said = Vec::new();
    if marks != Marks::None {
        said.extend(notes(table, &unranked));
        said.extend(notes_on_rows(table, one_ranking));
    }
    table.unranked = unranked;
    said
}

/// Positions of the measured rows whose values of a column may be ranked. The mean of several trainings compares if these do.
pub(super) fn rankable_rows(table: &Table, index: CellIndex) -> Vec<usize> {
    let measured = printed(table, index, &|row| row.origin == Origin::Measured);
    measured.into_iter().map(|value| value.at).filter(|at| !table.rows[*at].is_over_trainings()).collect()
}

/// Why the measured values of a column do not compare; `None` if they do.
fn why_incomparable(table: &Table, index: CellIndex, direction: Direction) -> Option<Incomparable> {
    let rows = rankable_rows(table, index);
    if table.forced && rows.len() > 1 {
        return Some(Incomparable::Protocols);
    }
    let cells: Vec<&Cell> = rows.iter().map(|at| table.rows[*at].cell(index)).collect();
    // The same row without leaked targets follows it, if it has any.
    let without_leaked = |at: usize| {
        let next = table.rows.get(at + 1).filter(|row| row.without_leaked)?.cell(index);
        next.value.number().map(|_| next)
    };
    let cells_without_leaked: Vec<&Cell> =
        rows.iter().zip(&cells).map(|(at, cell)| without_leaked(*at).unwrap_or(cell)).collect();
    // A method all of whose renders are identical to the truth has no number, and would be the best.
    let would_be_first = || !cells.is_empty() && has_row_of_identical_renders(table, index);
    incomparable(&cells, &cells_without_leaked, direction)
        .or_else(|| would_be_first().then_some(Incomparable::Identical))
}

/// Whether a row that is ranked in other columns has no number, because all of its renders are identical to the truth.
fn has_row_of_identical_renders(table: &Table, index: CellIndex) -> bool {
    let rows = table.rows.iter().filter(|row| row.origin == Origin::Measured && is_ranked(row));
    rows.map(|row| row.cell(index))
        .any(|cell| cell.value.number().is_none() && cell.with_identical.is_some() && cell.is_rankable())
}

/// Whether a row may be the best of its columns.
pub(super) const fn is_ranked(row: &Row) -> bool {
    !row.untrained && !row.without_leaked
}

/// Whether published and measured values of a column may be ranked together: not times, nor scores with unpublished weights.
fn has_one_ranking(table: &Table, index: CellIndex) -> bool {
    let rows = rankable_rows(table, index);
    let cells: Vec<&Cell> = rows.iter().map(|at| table.rows[*at].cell(index)).collect();
    let column = table.column(index);
    column.quantity != Quantity::Seconds && has_published_weights(column, &cells)
}

/// A note for each reason.
fn notes(table: &Table, unranked: &[(CellIndex, Incomparable)]) -> Vec<Note> {
    let mut columns: BTreeMap<Incomparable, Vec<String>> = BTreeMap::new();
    for (index, why) in unranked {
        columns.entry(*why).or_default().push(table.heading(*index));
    }
    let note = |(why, columns): (Incomparable, Vec<String>)| {
        let (why, columns) = (why.in_words(), columns.join(", "));
        let text = format!("no measured number is marked as best, because {why}: {columns}");
        Note { kind: NoteKind::Unranked, text }
    };
    columns.into_iter().map(note).collect()
}

/// Why the measured values of a column do not compare.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(in crate::table) enum Incomparable {
    /// Other protocols, which `--force` put into one table.
    Protocols,
    /// Other targets or trials.
    Targets,
    /// Without the renders that are identical to the truth, the order differs: a method would lose by its best targets.
    Identical,
    /// Without targets that are context frames, the order differs: a copy of one scores tens of decibels more than any view.
    Leaked,
    /// Other learned weights of the metric.
    Weights,
    /// Times of another machine or device.
    Machines,
}

impl Incomparable {
    /// The reason as the end of a sentence.
    pub(in crate::table) const fn in_words(self) -> &'static str {
        match self {
            Self::Protocols => "rows are of different protocols",
            Self::Targets => "rows are over different scenes or targets",
            Self::Identical => "renders that are identical to the truth, which means leave out, would change the order",
            Self::Leaked => "the order differs without targets that are context frames",
            Self::Weights => "metrics have different weights",
            Self::Machines => "times are of different machines or devices",
        }
    }
}

fn incomparable(cells: &[&Cell], cells_without_leaked: &[&Cell], direction: Direction) -> Option<Incomparable> {
    if differ(cells.iter().map(|cell| cell.set_hash)) {
        return Some(Incomparable::Targets);
    }
    let order = |cells: &[&Cell], value: &dyn Fn(&Cell) -> Option<f64>| {
        let mut order: Vec<(usize, f64)> =
            cells.iter().enumerate().filter_map(|(at, cell)| Some((at, value(cell)?))).collect();
        order.sort_by(|(_, a), (_, b)| in_direction(direction, *a, *b));
        order.into_iter().map(|(at, _)| at).collect::<Vec<_>>()
    };
    let number = |cell: &Cell| cell.value.number();
    if order(cells, &number) != order(cells, &|cell| cell.with_identical.or_else(|| number(cell))) {
        return Some(Incomparable::Identical);
    }
    if order(cells, &number) != order(cells_without_leaked, &number) {
        return Some(Incomparable::Leaked);
    }
    if differ(cells.iter().map(|cell| &cell.metric_weights)) {
        return Some(Incomparable::Weights);
    }
    let machines = cells.iter().map(|cell| cell.timing.as_ref().map(|timing| (&timing.machine, &timing.device)));
    differ(machines).then_some(Incomparable::Machines)
}

/// The better value first.
pub(super) fn in_direction(direction: Direction, a: f64, b: f64) -> Ordering {
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
    let Quantity::Metric(metric) = column.quantity else { return true };
    let Some(network) = metric.network() else { return true };
    let mut weights = cells.iter().filter_map(|cell| cell.metric_weights.as_deref());
    weights.all(|sha256| network.is_published(sha256))
}

/// A value that may be ranked.
#[derive(Clone, Copy)]
struct Printed {
    /// The position of its row.
    at: usize,
    /// As printed.
    value: f64,
    /// With the digits that papers print: of counts, whole thousands.
    as_papers: f64,
    is_published: bool,
}

impl Printed {
    /// The better value first. Only a measured and a published one have the papers' digits in common.
    fn compared(&self, other: &Self, direction: Direction) -> Ordering {
        if self.is_published == other.is_published {
            in_direction(direction, self.value, other.value)
        } else {
            in_direction(direction, self.as_papers, other.as_papers)
        }
    }

    fn is_beaten(&self, among: &[Self], direction: Direction) -> bool {
        among.iter().any(|other| other.compared(self, direction).is_lt())
    }
}

/// The printed values of a column that may be ranked.
fn printed(table: &Table, index: CellIndex, included: &dyn Fn(&Row) -> bool) -> Vec<Printed> {
    let rows = table.rows.iter().enumerate().filter(|(_, row)| included(row) && is_ranked(row));
    rows.filter_map(|(at, row)| printed_value(table, at, row, index)).collect()
}

fn rank_column(
    table: &mut Table,
    index: CellIndex,
    direction: Direction,
    marks: Marks,
    included: &dyn Fn(&Row) -> bool,
) {
    let printed = printed(table, index, included);
    // A single value is not ranked.
    if printed.len() < 2 || marks == Marks::None {
        return;
    }
    let (best, second) = best_and_second(&printed, direction);
    if best.len() == printed.len() {
        return;
    }
    let seconds =
        if marks == Marks::BestAndSecond && second.len() <= 2 && printed.len() > 2 { second } else { Vec::new() };
    for (rows, mark) in [(best, Mark::Best), (seconds, Mark::Second)] {
        for at in rows {
            table.rows[at].cells[index.group][index.column].mark = mark;
        }
    }
}

/// The rows whose values no other is better than, and those of the rest.
fn best_and_second(printed: &[Printed], direction: Direction) -> (Vec<usize>, Vec<usize>) {
    let (rest, best): (Vec<Printed>, Vec<Printed>) =
        printed.iter().copied().partition(|value| value.is_beaten(printed, direction));
    let second = rest.iter().filter(|value| !value.is_beaten(&rest, direction));
    (best.iter().map(|value| value.at).collect(), second.map(|value| value.at).collect())
}

fn printed_value(table: &Table, at: usize, row: &Row, index: CellIndex) -> Option<Printed> {
    let cell = row.cell(index);
    let value = cell.value.number().filter(|_| cell.is_rankable())?;
    let column = table.column(index);
    let as_papers = number(&column.format_as_papers(value))?;
    let value = if cell.published { as_papers } else { number(&column.format(value))? };
    Some(Printed { at, value, as_papers, is_published: cell.published })
}

/// A printed number, which may be in thousands or millions.
fn number(text: &str) -> Option<f64> {
    let units = [('K', 1e3), ('M', 1e6)];
    let in_unit = units.iter().find_map(|(unit, scale)| Some((text.strip_suffix(*unit)?, *scale)));
    let (digits, scale) = in_unit.unwrap_or((text, 1.0));
    digits.parse::<f64>().ok().map(|value| value * scale)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::definition::TableDefinition;

    /// Of a column with 24 100 and 24 900 measured, and 24K in a paper, which may be either.
    #[test]
    fn only_a_measured_and_a_published_count_compare_in_the_digits_of_papers() {
        let measured = |at, value: f64| Printed { at, value, as_papers: 24e3, is_published: false };
        let paper = |at, value: f64| Printed { at, value, as_papers: value, is_published: true };
        let few = [measured(0, 24.9e3), measured(1, 24.1e3), paper(2, 24e3)];
        assert_eq!(best_and_second(&few, Direction::Lower), (vec![1, 2], vec![0]));
        let more = [measured(0, 24.9e3), paper(1, 23e3), measured(2, 24.1e3), paper(3, 25e3)];
        assert_eq!(best_and_second(&more, Direction::Lower), (vec![1], vec![2]));
        assert_eq!(best_and_second(&more, Direction::Higher), (vec![3], vec![0]));
        assert_eq!(["24K", "5.9M", "512", "n/c"].map(number), [Some(24e3), Some(5.9e6), Some(512.0), None]);
    }

    #[test]
    fn weights_of_another_hash_are_not_the_published_ones() {
        let definition = TableDefinition::named("re10k").unwrap();
        let table = crate::table::build::table(&definition, &[], None);
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
