//! Scenes and targets of rows, their intervals, and trials that look wrong.

use atsplat_eval::suspicious_notes::SuspiciousNote;
use atsplat_numeric::{distinct, grouped};
use atsplat_results::statistics::{CONFIDENCE, MIN_SCENES, outside_bins_in_words};
use atsplat_results::{TrialNote, TrialRow};

use super::{Notes, counts_of_each};
use crate::definition::Quantity;
use crate::table::selection::{ComparableResults, MethodRun};
use crate::table::{Cell, Column, Counts, Group, NoteKind, Row, Table, Value};

impl Notes {
    /// Scenes and targets of a row, and its targets outside all bins; groups of columns with equal counts are listed together.
    pub(super) fn counts(&mut self, table: &Table, row: &Row) {
        let groups = table.groups.iter().zip(&row.cells).filter(|(group, _)| !is_derived(group));
        let titles_by_text = grouped(groups.filter_map(|(group, cells)| {
            let title = if group.title.is_empty() { "all" } else { group.title.as_str() };
            Some((counts_of(cells)?, title))
        }));
        let mut parts: Vec<String> = match titles_by_text.as_slice() {
            [(text, _)] => vec![text.clone()],
            several => several.iter().map(|(text, titles)| format!("{}: {text}", titles.join(", "))).collect(),
        };
        // The same for each bin.
        let outside = row.cells.iter().flatten().filter_map(|cell| cell.counts).map(|counts| counts.outside_bins).max();
        if let Some(outside) = outside.filter(|outside| *outside > 0) {
            parts.push(outside_bins_in_words(outside));
        }
        if !parts.is_empty() {
            self.add(NoteKind::Counts, format!("{}: {}", row.printed_name(), parts.join("; ")));
        }
    }

    /// Trials that count in a row's means although their renders show nothing, or have a suspicious note.
    pub(super) fn suspicious(&mut self, row: &Row, results: &ComparableResults<'_>) {
        let trials = trials_of(row, results);
        let all = trials.len();
        let with_note =
            |kind: SuspiciousNote| trials.iter().filter(|trial| trial.notes.iter().any(|note| kind.is(note))).count();
        let undrawn = trials.iter().filter(|trial| trial.renders_nothing()).count();
        let mut parts = Vec::new();
        if undrawn > 0 {
            parts.push(format!(
                "no Gaussian is rendered in {undrawn} of {all} trials, whose images show the background"
            ));
        }
        for kind in SuspiciousNote::ALL {
            let count = with_note(kind);
            if count > 0 {
                parts.push(format!("{} in {count} of {all} trials", kind.remark()));
            }
        }
        if !parts.is_empty() {
            self.add(
                NoteKind::Counts,
                format!("{}: {}; not left out of the mean", row.printed_name(), parts.join("; ")),
            );
        }
    }

    /// Trials whose network saw context images at another size than the protocol's, which decides its tokens and Gaussians.
    pub(super) fn resized(&mut self, row: &Row, results: &ComparableResults<'_>) {
        let trials = trials_of(row, results);
        let notes = trials.iter().flat_map(|trial| &trial.notes);
        let sizes = notes.filter_map(|note| match TrialNote::of(note)? {
            TrialNote::SawResized { sizes } => Some(sizes),
            TrialNote::StepsTaken { .. } => None,
        });
        let sizes = counts_of_each(sizes);
        let all = trials.len();
        let parts: Vec<String> =
            sizes.into_iter().map(|(sizes, count)| format!("{sizes} in {count} of {all} trials")).collect();
        if !parts.is_empty() {
            self.add(NoteKind::Setting, format!("{}: the network saw {}", row.printed_name(), parts.join(", ")));
        }
    }

    /// The rows whose number of Gaussians was stated: nobody could count them in images.
    pub(super) fn stated(&mut self, table: &Table) {
        let is_stated = |row: &&Row| row.cells.iter().flatten().any(Cell::is_stated_count);
        let stated: Vec<String> = table.rows.iter().filter(is_stated).map(Row::printed_name).collect();
        if !stated.is_empty() {
            self.add(NoteKind::Stated, format!("{}: Gaussians stated, not counted", stated.join("; ")));
        }
    }

    pub(super) fn intervals(&mut self, table: &Table, row: &Row) {
        let mut groups: Vec<String> = Vec::new();
        for (group, cells) in table.groups.iter().zip(&row.cells) {
            let intervals: Vec<String> =
                group.columns.iter().zip(cells).filter_map(|(column, cell)| interval_of(column, cell)).collect();
            if !intervals.is_empty() {
                let title = if group.title.is_empty() { String::new() } else { format!("{}: ", group.title) };
                groups.push(format!("{title}{}", intervals.join(", ")));
            }
        }
        if !groups.is_empty() {
            let percent = CONFIDENCE * 100.0;
            self.add(
                NoteKind::Interval,
                format!("{percent:.0} % over scenes, {}: {}", row.printed_name(), groups.join("; ")),
            );
        }
    }

    /// What intervals are; numbers without any, because their scenes are too few.
    pub(super) fn few_scenes(&mut self, table: &Table) {
        let cells = table.rows.iter().flat_map(|row| row.cells.iter().flatten());
        if cells.clone().any(|cell| cell.interval.is_some()) {
            let text = "95 % intervals: expanded percentile bootstrap over scenes (Hesterberg 2015); with several trainings, \
                        Student's t";
            self.add(NoteKind::Interval, text.to_owned());
        }
        let mut counts = cells.filter(|cell| cell.value.number().is_some()).filter_map(|cell| cell.counts);
        if counts.any(|counts| counts.scenes < MIN_SCENES) {
            self.add(NoteKind::LeftOut, format!("no interval with fewer than {MIN_SCENES} scenes"));
        }
    }

    /// Renders that are identical to the truth.
    pub(super) fn left_out(&mut self, table: &Table) {
        let cells = table.rows.iter().flat_map(|row| row.cells.iter().flatten());
        if cells.filter_map(|cell| cell.counts).any(|counts| counts.identical > 0) {
            let text = "renders that are identical to the truth, whose PSNR is infinite, are counted and left out of all \
                        means";
            self.add(NoteKind::LeftOut, text.to_owned());
        }
    }
}

/// Slopes and differences are over the targets of other columns, which would be listed twice.
fn is_derived(group: &Group) -> bool {
    let is_derived = |quantity: Quantity| matches!(quantity, Quantity::Slope(..) | Quantity::Difference(_));
    group.columns.iter().all(|column| is_derived(column.quantity))
}

/// Columns of a group have the same targets: the counts of the first computed metric hold for all.
fn counts_of(cells: &[Cell]) -> Option<String> {
    let with_counts: Vec<(&Cell, Counts)> = cells.iter().filter_map(|cell| Some((cell, cell.counts?))).collect();
    let (cell, counts) = with_counts.iter().find(|(_, counts)| counts.targets > 0).or(with_counts.first())?;
    let mut text = cell.counts_in_words()?;
    if with_counts.iter().any(|(_, other)| other.targets > 0 && other.targets != counts.targets) {
        text.push_str(", metrics over different targets");
    }
    Some(text)
}

/// The trials behind a row; none for a mean over trainings and a row without leaked targets, whose trials are those of other rows.
fn trials_of<'a>(row: &Row, results: &'a ComparableResults<'a>) -> Vec<&'a TrialRow> {
    if row.without_leaked || row.is_over_trainings() {
        return Vec::new();
    }
    let runs = distinct(row.protocols.iter().flatten()).into_iter().filter_map(|protocol| results.run_of(protocol));
    runs.flat_map(MethodRun::trials).collect()
}

/// `PSNR 21.25 [19.10, 23.40]`; `None` where there is no interval, or the cell prints it.
fn interval_of(column: &Column, cell: &Cell) -> Option<String> {
    let (Value::Number(number), Some(ends)) = (&cell.value, cell.interval.filter(|_| !column.intervals)) else {
        return None;
    };
    let [_, low, high] = column.format_with(*number, ends);
    Some(format!("{} {} [{low}, {high}]", column.title, cell.print(column)))
}
