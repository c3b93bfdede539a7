//! Which methods the rows of a table show, and what its choice leaves out.

use atsplat_numeric::distinct;

use super::{ComparableResults, StoreMethod, has_trials};
use crate::definition::{TableDefinition, is_called};
use crate::plot::Origin;
use crate::table::{Note, NoteKind, Row, StoreProtocol};

impl ComparableResults<'_> {
    /// The place of a method in the chosen order; `None` if it is not chosen.
    pub(in crate::table) fn place_of(&self, method: StoreMethod<'_>) -> Option<usize> {
        let StoreMethod { store, record } = method;
        let chosen = &self.choice.methods;
        if chosen.is_empty() { Some(0) } else { chosen.iter().position(|name| is_called(store, record, name)) }
    }

    /// Sorts rows by the chosen order of their methods, unless the paper's rows are between them, which those that reproduce one
    /// follow. A mean over trainings stays behind these.
    pub(in crate::table) fn sort_by_choice(&self, rows: &mut [Row]) {
        if self.choice.methods.is_empty() || rows.iter().any(|row| row.origin == Origin::Published) {
            return;
        }
        rows.sort_by_key(|row| self.place_of_row(row));
        // A line would divide rows that reproduce one of the paper's from the others.
        for row in rows {
            row.rule_above = false;
        }
    }

    /// The place of a row's method, or the last of those of its trainings.
    fn place_of_row(&self, row: &Row) -> Option<usize> {
        let place = |protocol: &StoreProtocol| {
            let run = self.run_of(protocol)?;
            self.place_of(StoreMethod { store: run.part.source.label, record: run.record })
        };
        row.all_measured().filter_map(place).max()
    }

    /// A note on what the choice left out of a table; `None` if nothing.
    pub(in crate::table) fn left_out_by_choice(&self, definition: &TableDefinition) -> Option<Note> {
        let methods = self.parts.iter().flat_map(move |part| {
            let (results, store) = (part.source.results, part.source.label);
            let was_run = move |name: &str| has_trials(results, &part.preset.name, name);
            let methods = results.provenance.methods.iter().filter(move |record| was_run(&record.name));
            methods.filter(move |record| self.place_of(StoreMethod { store, record }).is_none())
        });
        let methods = distinct(methods.map(|record| record.name.as_str()));
        let mut parts = Vec::new();
        for (what, names) in [("columns", definition.columns_left_out.join(", ")), ("methods", methods.join(", "))] {
            parts.extend((!names.is_empty()).then(|| format!("{what} {names}")));
        }
        let without_published = self.choice.without_published && !definition.published.is_empty();
        parts.extend(without_published.then(|| "the paper's rows".to_owned()));
        let text = format!("left out by choice: {}", parts.join("; "));
        (!parts.is_empty()).then_some(Note { kind: NoteKind::Choice, text })
    }
}
