//! Which columns and rows of tables a report shows, and what it compares them with.

use atsplat_numeric::distinct;
use atsplat_results::{MethodRecord, PresetRecord};

use super::{ColumnDefinition, Quantity, TableDefinition};
use crate::ReportError;
use crate::table::{Source, has_trials, is_same_data};

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
    /// Decimals of the measured numbers of metrics and seconds, in place of those that papers print.
    pub decimals: Vec<(Quantity, usize)>,
}

impl Choice {
    /// The chosen decimals of a column; a metric's difference has those of the metric.
    pub(crate) fn decimals_of(&self, quantity: Quantity) -> Option<usize> {
        let of = if let Quantity::Difference(metric) = quantity { Quantity::Metric(metric) } else { quantity };
        self.decimals.iter().find(|(chosen, _)| *chosen == of).map(|(_, decimals)| *decimals)
    }

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
            let several = if option == "against" { namesakes(sources, name) } else { Vec::new() };
            if !several.is_empty() {
                return Err(wrong(option, several.iter().map(String::as_str).collect(), name));
            }
        }
        Ok(())
    }
}

/// Whether `name` is what tables call a method: its name, its title, `STORE: NAME`, or its title with one of the names in parentheses;
/// also `STORE:NAME`.
pub(crate) fn is_called(store: &str, record: &MethodRecord, name: &str) -> bool {
    let names = [record.name.clone(), format!("{store}: {}", record.name)];
    name == record.title
        || names.iter().any(|own| name == own || name == format!("{} ({own})", record.title))
        || name == format!("{store}:{}", record.name)
}

/// The methods that are called so, each as `STORE: NAME`, if two of them are others that were run under one protocol on the same data:
/// both have a row in one table, and either may be meant. Empty otherwise.
fn namesakes(sources: &[Source<'_>], name: &str) -> Vec<String> {
    let mut called: Vec<(&Source<'_>, &MethodRecord)> = Vec::new();
    for source in sources {
        let records = source.results.provenance.methods.iter();
        called.extend(records.filter(|record| is_called(source.label, record, name)).map(|record| (source, record)));
    }
    let is_ambiguous = called.iter().enumerate().any(|(at, one)| {
        called.iter().skip(at + 1).any(|other| !is_same_method(one.1, other.1) && have_one_protocol(*one, *other))
    });
    if !is_ambiguous {
        return Vec::new();
    }
    called.into_iter().map(|(source, record)| format!("{}: {}", source.label, record.name)).collect()
}

/// Whether records of two stores are of one method: with the same weights and settings, and on the same kind of device.
fn is_same_method(one: &MethodRecord, other: &MethodRecord) -> bool {
    (&one.kind, &one.weights_sha256, one.untrained) == (&other.kind, &other.weights_sha256, other.untrained)
        && one.parameters == other.parameters
        && (&one.network_adapter, &one.renderer_adapter) == (&other.network_adapter, &other.renderer_adapter)
}

/// Whether two methods were run under one protocol and index on the same data.
fn have_one_protocol(one: (&Source<'_>, &MethodRecord), other: (&Source<'_>, &MethodRecord)) -> bool {
    let presets = |(source, record): (&Source<'_>, &MethodRecord)| -> Vec<PresetRecord> {
        let all = source.results.provenance.presets.iter();
        all.filter(|preset| has_trials(source.results, &preset.name, &record.name)).cloned().collect()
    };
    let of_other = presets(other);
    presets(one).iter().any(|preset| {
        of_other.iter().any(|known| {
            let is_one = (&known.hash, &known.index_sha256) == (&preset.hash, &preset.index_sha256);
            is_one && is_same_data([(one.0.results, preset.name.as_str()), (other.0.results, known.name.as_str())])
        })
    })
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
