//! Which methods the rows of a table show, and what its choice leaves out.

use atsplat_numeric::distinct;

use super::comparable::{ComparableResults, StoreMethod};
use super::{Note, NoteKind, has_trials};
use crate::definition::{TableDefinition, is_called};

impl ComparableResults<'_> {
    /// The place of a method in the chosen order; `None` if it is not chosen.
    pub(super) fn place_of(&self, method: StoreMethod<'_>) -> Option<usize> {
        let StoreMethod { store, record } = method;
        let chosen = &self.choice.methods;
        if chosen.is_empty() { Some(0) } else { chosen.iter().position(|name| is_called(store, record, name)) }
    }

    /// A note on what the choice left out of a table; `None` if nothing.
    pub(super) fn left_out_by_choice(&self, definition: &TableDefinition) -> Option<Note> {
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
