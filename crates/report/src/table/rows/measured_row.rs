//! The measured rows of a method: one for each protocol under which it was run, and the same without leaked targets.

use atsplat_numeric::distinct;
use atsplat_results::MethodRecord;
use atsplat_results::statistics::Leaked;

use super::measure::cells;
use super::measured_on::{MeasuredOn, ProtocolRun};
use super::remarks::LEAKED_EXCLUDED;
use crate::definition::{ColumnGroup, MeasuredLabel, PublishedRow, RowDefinition, TableDefinition};
use crate::plot::Origin;
use crate::table::selection::{ComparableResults, MethodRun, Part, StoreMethod};
use crate::table::{Cell, Row, StoreProtocol};

/// A published row that measured rows reproduce.
#[derive(Clone, Copy, Debug)]
pub(super) struct Reproduced<'a> {
    /// Its position among the published rows.
    pub(super) position: usize,
    pub(super) row: &'a PublishedRow,
    pub(super) definition: &'a RowDefinition,
}

/// The method that measured rows show, and the published row that they reproduce.
#[derive(Clone, Copy, Debug)]
pub(super) struct RowSource<'a> {
    pub(super) definition: &'a TableDefinition,
    pub(super) results: &'a ComparableResults<'a>,
    pub(super) reproduced: Option<Reproduced<'a>>,
    /// `None` if each group of columns has its own method.
    pub(super) method: Option<StoreMethod<'a>>,
}

/// A measured row: for each group of columns, the results that fill it.
struct MeasuredRow<'a> {
    source: RowSource<'a>,
    runs_by_group: Vec<Option<MethodRun<'a>>>,
}

impl<'a> RowSource<'a> {
    /// A row for each protocol of the table under which the method was run, each followed by the same without leaked targets if
    /// there are any; empty if the method was not run.
    pub(super) fn rows(self) -> Vec<Row> {
        let measured = self.measured_rows();
        let mut rows = Vec::new();
        for measured_row in &measured {
            for mut row in measured_row.rows() {
                // Data, size and number of scenes may be the same.
                row.remarks.extend((measured.len() > 1).then(|| format!("under {}", measured_row.presets())));
                rows.push(row);
            }
        }
        rows
    }

    fn measured_rows(self) -> Vec<MeasuredRow<'a>> {
        let groups = self.definition.groups.iter();
        let runs: Vec<Vec<MethodRun<'a>>> = groups.map(|group| self.runs_of_group(group)).collect();
        // Where each group has its own method, the first that was run fills it.
        let most = if self.method.is_some() { usize::MAX } else { 1 };
        let count = runs.iter().map(Vec::len).max().unwrap_or_default().min(most);
        let row = |at: usize| {
            let runs_by_group = runs.iter().map(|runs_of_group| runs_of_group.get(at).copied()).collect();
            MeasuredRow { source: self, runs_by_group }
        };
        (0..count).map(row).collect()
    }

    /// The results that can fill a group of columns: those under its preset, or under that of the row.
    fn runs_of_group(self, group: &ColumnGroup) -> Vec<MethodRun<'a>> {
        let preset_of_row = self.reproduced.and_then(|reproduced| reproduced.definition.preset.as_deref());
        let preset = preset_of_row.or(group.preset.as_deref());
        let parts = self.results.parts.iter().filter(|part| Some(part.preset.published()) == preset);
        parts.filter_map(|part| self.run_in(part, group)).collect()
    }

    /// The method's results in a part, or those of the first method that the group accepts.
    fn run_in(self, part: &'a Part<'a>, group: &ColumnGroup) -> Option<MethodRun<'a>> {
        if self.method.is_some_and(|method| method.store != part.source.label) {
            return None;
        }
        let store = part.source.label;
        let is_wanted = |record: &MethodRecord| match self.method {
            Some(method) => record.name == method.record.name,
            None => {
                group.method.as_ref().is_some_and(|rule| rule.accepts(record))
                    && self.results.place_of(StoreMethod { store, record }).is_some()
            }
        };
        part.first_run(is_wanted)
    }

    /// The labels of the published row, or the method's title; methods with the same title are distinguished by name and store.
    fn labels(self) -> Vec<String> {
        let mut labels = vec![String::new(); self.definition.labels.len()];
        let published = self.reproduced.map(|reproduced| &reproduced.row.labels);
        let Some(method) = self.method else { return published.cloned().unwrap_or(labels) };
        let name = distinguishing_name(method, &self.results.store_methods());
        if let Some(published) = published.filter(|_| self.definition.measured_label == MeasuredLabel::Published) {
            labels.clone_from(published);
            if let Some(last) = labels.last_mut() {
                last.push_str(&name);
            }
        } else if let Some(first) = labels.first_mut() {
            *first = format!("{}{name}", method.record.title);
        }
        labels
    }
}

/// ` (NAME)`, or ` (STORE: NAME)` if methods of one title share the name too; empty for the only method of its title.
fn distinguishing_name(method: StoreMethod<'_>, all: &[StoreMethod<'_>]) -> String {
    let of_title = || all.iter().filter(|other| other.record.title == method.record.title);
    let of_name = of_title().filter(|other| other.record.name == method.record.name);
    match (of_title().count() > 1, of_name.count() > 1) {
        (false, _) => String::new(),
        (true, false) => format!(" ({})", method.record.name),
        (true, true) => format!(" ({}: {})", method.store, method.record.name),
    }
}

impl<'a> MeasuredRow<'a> {
    /// The row, followed by the same without leaked targets if there are any.
    fn rows(&self) -> Vec<Row> {
        let row = self.row();
        if !self.has_leaked() {
            return vec![row];
        }
        let mut others = Row { without_leaked: true, cells: self.cells(Leaked::Excluded), ..row.clone() };
        others.remarks.push(LEAKED_EXCLUDED.to_owned());
        vec![row, others]
    }

    /// The row over all targets.
    fn row(&self) -> Row {
        let RowSource { results, reproduced, method, .. } = self.source;
        let protocols: Vec<Option<StoreProtocol>> =
            self.runs_by_group.iter().map(|run| run.map(|run| run.store_protocol(results.remarks(run)))).collect();
        Row {
            labels: self.labels(),
            origin: Origin::Measured,
            published_row: reproduced.map(|reproduced| reproduced.position),
            measured_on: Some(self.measured_on()),
            remarks: distinct(protocols.iter().flatten().flat_map(|protocol| &protocol.remarks).cloned()),
            method: method.map(|method| method.record.name.clone()),
            store: self.runs().next().map(|run| run.part.source.label.to_owned()),
            protocols,
            trainings: Vec::new(),
            untrained: self.runs().any(|run| run.record.untrained),
            inference_only: self.runs().any(|run| results.is_inference_only(run.record)),
            not_retrained: self.runs().any(|run| results.is_not_retrained(run.record)),
            without_leaked: false,
            rule_above: false,
            cells: self.cells(Leaked::Included),
        }
    }

    fn runs(&self) -> impl Iterator<Item = MethodRun<'a>> {
        self.runs_by_group.iter().flatten().copied()
    }

    fn presets(&self) -> String {
        distinct(self.runs().map(MethodRun::preset_name)).join(", ")
    }

    /// The labels; where they print the published data or size, they say what was measured instead.
    fn labels(&self) -> Vec<String> {
        let definition = self.source.definition;
        let labels = self.source.labels();
        let first = self.runs().next().filter(|_| definition.measured_label == MeasuredLabel::Published);
        let Some(run) = first else { return labels };
        let label = |(column, label): (&str, String)| match column {
            "{dataset}" => run.part.data(),
            "{height}×{width}" => run.size().unwrap_or(label),
            "{views}" => run.context_views().map_or(label, |(numbers, _)| numbers),
            _ => label,
        };
        definition.labels.iter().map(|column| column.text.as_str()).zip(labels).map(label).collect()
    }

    fn measured_on(&self) -> MeasuredOn {
        let definition = self.source.definition;
        let groups = definition.groups.iter().zip(&self.runs_by_group);
        let protocol_runs: Vec<ProtocolRun<'_>> =
            groups.filter_map(|(group, run)| Some(ProtocolRun { heading: &group.title, run: (*run)? })).collect();
        // A row with the labels of a published row would not name its method otherwise.
        let has_published_labels =
            definition.measured_label == MeasuredLabel::Published && self.source.reproduced.is_some();
        let titles = distinct(self.runs().map(|run| run.record.title.as_str()));
        MeasuredOn::of(&protocol_runs, has_published_labels.then(|| titles.join(" and ")))
    }

    fn cells(&self, leaked: Leaked) -> Vec<Vec<Cell>> {
        let groups = self.source.definition.groups.iter().zip(&self.runs_by_group);
        groups
            .map(|(group, run)| match run {
                Some(run) => cells(*run, group, leaked, self.source.results.forced),
                None => vec![Cell::default(); group.columns.len()],
            })
            .collect()
    }

    /// Whether a metric is over targets some of which are also context frames.
    fn has_leaked(&self) -> bool {
        let mut columns = self.source.definition.groups.iter().flat_map(|group| &group.columns);
        columns.any(|column| column.quantity.metric().is_some()) && self.runs().any(MethodRun::has_leaked)
    }
}
