//! Which columns and rows of tables a report shows, and what it compares them with.

use atsplat_numeric::distinct;
use atsplat_results::MethodRecord;

use super::{ColumnDefinition, Quantity, TableDefinition};
use crate::ReportError;
use crate::table::Source;

/// Which columns and rows of tables are shown; by default all.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Choice {
    /// The quantities of the columns, in their order; empty for all. A metric includes its slopes.
    pub columns: Vec<Quantity>,
    /// The methods of the measured rows, in their order; empty for all. Each is called by its name in its store, by its title, or by
    /// `STORE: NAME`. Rows that reproduce one of the paper's stay below it, unless these are left out.
    pub methods: Vec<String>,
    /// Whether the paper's rows are left out.
    pub without_published: bool,
    /// The method to which tables give the paired differences of the measured rows, called as in `methods`.
    pub against: Option<String>,
}

impl Choice {
    /// Checks that the stores have every method of the choice, and that [`Self::against`] is only one of them.
    ///
    /// # Errors
    /// [`ReportError::Method`].
    pub(crate) fn check(&self, sources: &[Source<'_>]) -> Result<(), ReportError> {
        let methods: Vec<(&str, &MethodRecord)> = sources
            .iter()
            .flat_map(|source| source.results.provenance.methods.iter().map(move |record| (source.label, record)))
            .collect();
        let names = |is_wanted: &dyn Fn(&str, &MethodRecord) -> bool| {
            let wanted = methods.iter().filter(|(store, record)| is_wanted(store, record));
            distinct(wanted.map(|(_, record)| record.name.as_str()))
        };
        let wrong = |option, expected: Vec<&str>, found: &str| ReportError::Method {
            option,
            expected: expected.join(", "),
            found: found.to_owned(),
        };
        let against = self.against.iter().map(|name| ("against", name));
        for (option, name) in self.methods.iter().map(|name| ("methods", name)).chain(against) {
            let found = names(&|store, record| is_called(store, record, name));
            if found.is_empty() {
                return Err(wrong(option, names(&|_, _| true), name));
            }
            if option == "against" && found.len() > 1 {
                return Err(wrong(option, found, name));
            }
        }
        Ok(())
    }
}

/// Whether `name` is what tables call a method: its name, its title, `STORE: NAME`, or its title with one of the names in parentheses.
pub(crate) fn is_called(store: &str, record: &MethodRecord, name: &str) -> bool {
    let names = [record.name.clone(), format!("{store}: {}", record.name)];
    name == record.title || names.iter().any(|own| name == own || name == format!("{} ({own})", record.title))
}

impl TableDefinition {
    /// The table with the chosen columns, in the order of the choice; groups without any are left out. Its rows are chosen when it is
    /// filled.
    #[must_use]
    pub fn with_choice(mut self, choice: &Choice) -> Self {
        self.choice = choice.clone();
        if choice.columns.is_empty() {
            return self;
        }
        for group in &mut self.groups {
            let all = std::mem::take(&mut group.columns);
            for quantity in &choice.columns {
                group.columns.extend(all.iter().filter(|column| column.quantity.is_of(*quantity)).cloned());
            }
            let is_left_out = |column: &&ColumnDefinition| !group.columns.contains(*column);
            self.columns_left_out.extend(all.iter().filter(is_left_out).map(|column| column.title().to_owned()));
        }
        self.columns_left_out = distinct(self.columns_left_out);
        self.groups.retain(|group| !group.columns.is_empty());
        self
    }
}
