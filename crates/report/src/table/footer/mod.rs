//! What readers must know about a table, as notes below it: sources, protocols and conventions, counts and intervals, times, trends.
//! Notes on what does not compare come from `comparison`.

mod conventions;
#[cfg(test)]
mod conventions_tests;
mod counts;
#[cfg(test)]
mod counts_tests;
mod times;
mod trends;
#[cfg(test)]
mod trends_tests;

use atsplat_numeric::grouped;
use atsplat_results::statistics::{LEAKED_EXCLUDED, LEAKED_EXCLUDED_MEANS};

use super::selection::ComparableResults;
use super::{Note, NoteKind, Row, Table, Trainings};
use crate::definition::TableDefinition;
use crate::plot::Origin;

/// Everything that readers must know about a table.
pub(super) fn footer(
    table: &Table,
    definition: &TableDefinition,
    results: Option<&ComparableResults<'_>>,
) -> Vec<Note> {
    let mut notes = Notes::default();
    if table.is_published() {
        notes.add(NoteKind::Source, format!("paper: {}", definition.source));
        for note in &definition.notes {
            notes.add(NoteKind::Published, note.clone());
        }
    }
    if let Some(results) = results.filter(|_| table.is_measured()) {
        notes.add_measured(table, definition, results);
    }
    notes.list
}

/// Distinct notes, in order.
#[derive(Default)]
struct Notes {
    list: Vec<Note>,
}

impl Notes {
    fn add(&mut self, kind: NoteKind, text: String) {
        let note = Note { kind, text };
        if !self.list.contains(&note) {
            self.list.push(note);
        }
    }

    /// The notes on measured rows.
    fn add_measured(&mut self, table: &Table, definition: &TableDefinition, results: &ComparableResults<'_>) {
        self.mixing(results);
        self.protocols(table, results);
        self.metrics(table, definition, results);
        self.times(table);
        self.stated(table);
        for row in table.rows.iter().filter(|row| row.origin == Origin::Measured) {
            self.counts(table, row);
            self.suspicious(row, results);
            self.resized(row, results);
            self.intervals(table, row);
        }
        self.few_scenes(table);
        self.left_out(table);
        self.several_trainings(table);
        self.apart_by_data(table, results);
        self.trend_over_gaussians(table, definition, results);
        self.trends_of_differences(table, definition, results);
        self.trained_on(table, results);
        self.remarks(table);
    }

    /// Whether results of different protocols share the table, or why others do not.
    fn mixing(&mut self, results: &ComparableResults<'_>) {
        if results.mixed {
            self.add(
                NoteKind::Forced,
                "because of --force, this table mixes rows of different protocols, or of different images under one name; \
                 they are not comparable"
                    .to_owned(),
            );
        }
        if let Some(why) = &results.separated_because {
            self.add(NoteKind::Setting, why.clone());
        }
    }

    fn several_trainings(&mut self, table: &Table) {
        for row in &table.rows {
            for (index, column) in table.columns() {
                let Some(Trainings { count, training_deviation, scene_deviation }) = row.cell(index).trainings else {
                    continue;
                };
                let [over_trainings, over_scenes] =
                    [training_deviation, scene_deviation].map(|value| column.format(value));
                let text = format!(
                    "{}: {} has the standard deviation {over_trainings} over {count} trainings and {over_scenes} over \
                     scenes; its interval is for both",
                    row.printed_name(),
                    column.title,
                );
                self.add(NoteKind::Trainings, text);
            }
        }
    }

    /// What remarks on rows mean.
    fn remarks(&mut self, table: &Table) {
        let any = |has: fn(&Row) -> bool| table.rows.iter().any(has);
        let untrained =
            "untrained: random weights; such rows are not ranked, and their quality says nothing about the method";
        let not_retrained = "changed at inference only: the weights of another row in a network that was changed after \
                             training; for an ablation the paper trains one, unless it changes only thresholds or how \
                             many blocks expand";
        let leaked_excluded = format!("{LEAKED_EXCLUDED}: {LEAKED_EXCLUDED_MEANS}");
        for (applies, kind, text) in [
            (any(|row| row.untrained), NoteKind::Untrained, untrained),
            (any(|row| row.not_retrained), NoteKind::Setting, not_retrained),
            (any(|row| row.without_leaked), NoteKind::Counts, leaked_excluded.as_str()),
        ] {
            if applies {
                self.add(kind, text.to_owned());
            }
        }
    }
}

/// Each value once, with how often it occurs.
fn counts_of_each<'a>(values: impl Iterator<Item = &'a str>) -> Vec<(&'a str, usize)> {
    grouped(values.map(|value| (value, ()))).into_iter().map(|(value, times)| (value, times.len())).collect()
}
