use atsplat_eval::MethodRecord;
use atsplat_eval::statistics::Leaked;

use super::edition::{Edition, Part, editions};
use super::footer::footer;
use super::measure::{cells, has_leaked};
use super::measured_on::{MeasuredOn, ProtocolRun};
use super::orders::orders;
use super::rank::rank;
use super::trainings::{distinguish, mean_rows};
use super::{Cell, Column, Group, Row, Source, StoreProtocol, Table, Value, distinct, has_trials};
use crate::ReportError;
use crate::definition::{
    ColumnGroup, MeasuredLabel, PublishedRow, Quantity, RowDefinition, TableDefinition, by_quantile, has_own_training,
    is_ablation, is_full, zero_shot_note,
};
use crate::plot::Origin;

/// How results of different protocols are combined.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Mixing {
    /// Each protocol gets its own table.
    #[default]
    Apart,
    /// They share one table, which says so.
    Forced,
}

/// The tables of a definition: one per protocol that was run, or the published numbers alone.
///
/// # Errors
/// [`ReportError::Csv`] or [`ReportError::Definition`] if the published numbers cannot be read, [`ReportError::Store`]
/// for an invalid protocol in a store.
pub fn tables(definition: &TableDefinition, sources: &[Source<'_>], mixing: Mixing) -> Result<Vec<Table>, ReportError> {
    let published = definition.published()?.rows;
    let editions = editions(definition, sources, mixing == Mixing::Forced)?;
    let mut tables: Vec<Table> = Vec::new();
    for edition in &editions {
        let table = table(definition, &published, Some(edition));
        if table.is_measured() {
            tables.push(table);
        }
    }
    if tables.is_empty() {
        tables.push(table(definition, &published, None));
    }
    if tables.len() > 1 {
        for (at, table) in tables.iter_mut().enumerate() {
            table.name = format!("{}-{}", definition.name, at + 1);
        }
    }
    Ok(tables)
}

/// The table of an edition, or of the published numbers alone.
pub(super) fn table(definition: &TableDefinition, published: &[PublishedRow], edition: Option<&Edition<'_>>) -> Table {
    let mut rows = Vec::new();
    let mut claimed: Vec<(&str, &str)> = Vec::new();
    let mut means: Vec<(usize, String)> = Vec::new();
    for (at, row) in published.iter().enumerate() {
        let known = definition.row(&row.labels);
        rows.push(published_row(row, at, known));
        let Some((edition, known)) = edition.zip(known) else { continue };
        let methods = methods(definition, edition, known);
        for method in &methods {
            if let Some(method) = method {
                claimed.push((method.store, &method.record.name));
            }
            rows.extend(measured(definition, edition, Some((at, row, known)), *method));
        }
        let own = rows.iter().rposition(|row| row.origin == Origin::Published).map_or(0, |at| at + 1);
        for (row, trainings) in mean_rows(definition, edition, &rows[own..]) {
            means.push((rows.len(), trainings));
            rows.push(row);
        }
    }
    if let Some(edition) = edition.filter(|_| definition.others) {
        let others = all_methods(edition)
            .into_iter()
            .filter(|method| !claimed.contains(&(method.store, &method.record.name)))
            .filter(|method| definition.ablations || !is_ablation(method.record));
        let first = rows.len();
        for method in others {
            rows.extend(measured(definition, edition, None, Some(method)));
        }
        for (row, trainings) in mean_rows(definition, edition, &rows[first..]) {
            means.push((rows.len(), trainings));
            rows.push(row);
        }
        if let Some(row) = rows.get_mut(first) {
            row.rule_above = true;
        }
    }
    distinguish(&mut rows, &means);
    let mut table = Table {
        name: definition.name.clone(),
        title: definition.title.clone(),
        caption: caption(definition, &rows),
        labels: definition.labels.iter().map(|label| label.title.clone()).collect(),
        groups: definition.groups.iter().map(|own| group(definition, own, edition, &rows)).collect(),
        rows,
        footer: Vec::new(),
        orders: Vec::new(),
        forced: edition.is_some_and(|edition| edition.mixed),
    };
    let is_published = |row: &Row| row.measured_on.as_ref().is_none_or(|on| on.published_setting);
    let one_ranking = edition.is_some_and(|edition| !edition.mixed) && table.rows.iter().all(is_published);
    let unranked = rank(&mut table, definition.marks, one_ranking);
    table.orders = edition.map(|edition| orders(&table, definition, edition)).unwrap_or_default();
    table.footer = footer(&table, definition, edition);
    table.footer.extend(unranked);
    table
}

/// The definition's caption, and what the measured rows were measured on: the sentence that a pasted table keeps.
fn caption(definition: &TableDefinition, rows: &[Row]) -> String {
    /// More places are named in their rows alone.
    const MOST: usize = 2;
    let measured: Vec<&Row> = rows.iter().filter(|row| row.origin == Origin::Measured).collect();
    if measured.is_empty() {
        return definition.caption.clone();
    }
    let on = distinct(measured.iter().filter_map(|row| Some(row.measured_on.as_ref()?.place.as_str())));
    let place = match on.len() {
        0..=MOST => on.join("; "),
        _ => "what the row says".to_owned(),
    };
    let elsewhere = measured.iter().any(|row| row.measured_on.as_ref().is_some_and(|on| !on.published_setting));
    let published = rows.iter().any(|row| row.origin == Origin::Published);
    let comparable = if elsewhere && published { ": not comparable with the paper's numbers" } else { "" };
    format!("{} Measured on {place}{comparable}.", definition.caption)
}

fn group(definition: &TableDefinition, group: &ColumnGroup, edition: Option<&Edition<'_>>, rows: &[Row]) -> Group {
    let column = |column: &crate::definition::ColumnDefinition| Column {
        name: TableDefinition::published_name(group, column),
        title: column.title.clone().unwrap_or_else(|| column.quantity.title().to_owned()),
        quantity: column.quantity,
        direction: column.quantity.direction(),
        exact: column.exact,
        intervals: definition.intervals,
    };
    Group {
        title: group.title.clone(),
        preset: group.preset.clone(),
        measured_on: edition.and_then(|edition| edition.other_setting(group.preset.as_deref(), rows)),
        columns: group.columns.iter().map(column).collect(),
    }
}

fn published_row(row: &PublishedRow, at: usize, known: Option<&RowDefinition>) -> Row {
    let cell = |value: &Value| Cell { value: value.clone(), ..Cell::default() };
    Row {
        labels: row.labels.clone(),
        origin: Origin::Published,
        answers: Some(at),
        measured_on: None,
        remarks: Vec::new(),
        method: None,
        store: None,
        protocols: Vec::new(),
        trainings: Vec::new(),
        untrained: false,
        inference_only: false,
        not_retrained: false,
        without_leaked: false,
        rule_above: known.is_some_and(|known| known.rule_above),
        cells: row.values.iter().map(|values| values.iter().map(cell).collect()).collect(),
    }
}

/// A method of a store.
#[derive(Clone, Copy, Debug)]
struct Candidate<'a> {
    store: &'a str,
    record: &'a MethodRecord,
}

fn all_methods<'a>(edition: &Edition<'a>) -> Vec<Candidate<'a>> {
    let mut methods: Vec<Candidate<'a>> = Vec::new();
    for part in &edition.parts {
        for record in &part.source.results.provenance.methods {
            let store = part.source.label;
            if !methods.iter().any(|other| other.store == store && other.record.name == record.name) {
                methods.push(Candidate { store, record });
            }
        }
    }
    methods
}

/// The methods that reproduce a row; a single `None` if each group has its own method.
fn methods<'a>(definition: &TableDefinition, edition: &Edition<'a>, row: &RowDefinition) -> Vec<Option<Candidate<'a>>> {
    if definition.groups.iter().filter(|group| group.method.is_some()).count() > 1 {
        return vec![None];
    }
    let rule = row.method.as_ref().or_else(|| definition.groups.iter().find_map(|group| group.method.as_ref()));
    let Some(rule) = rule else { return Vec::new() };
    all_methods(edition).into_iter().filter(|method| rule.accepts(method.record)).map(Some).collect()
}

/// Whether an ablation that the paper trains has the weights of another network of any store, so that it was changed only
/// after training.
pub(super) fn is_not_retrained(edition: &Edition<'_>, record: &MethodRecord) -> bool {
    has_own_training(record) && has_weights_of(edition, record, |other| !has_own_training(other))
}

/// Whether a method runs the weights of another method under another configuration that expands or selects differently.
fn is_inference_only(edition: &Edition<'_>, record: &MethodRecord) -> bool {
    let trained_so = |other: &MethodRecord| is_full(other) || (is_ablation(record) && !is_ablation(other));
    (!is_full(record) && has_weights_of(edition, record, trained_so)) || is_not_retrained(edition, record)
}

/// Whether any such method of any store has the weights of this one.
fn has_weights_of(edition: &Edition<'_>, record: &MethodRecord, is_such: impl Fn(&MethodRecord) -> bool) -> bool {
    let mut methods = edition.parts.iter().flat_map(|part| &part.source.results.provenance.methods);
    record.weights_sha256.is_some()
        && methods.any(|other| other.weights_sha256 == record.weights_sha256 && is_such(other))
}

/// The measured row, followed by the same without leaked targets if there are any; empty if the method was not run. A
/// method that was run under several protocols of the table has a row for each.
fn measured(
    definition: &TableDefinition,
    edition: &Edition<'_>,
    reproduced: Option<(usize, &PublishedRow, &RowDefinition)>,
    method: Option<Candidate<'_>>,
) -> Vec<Row> {
    let runs = runs(definition, edition, reproduced.map(|(_, _, row)| row), method);
    let mut rows = Vec::new();
    for chosen in &runs {
        let mut own = measured_once(definition, edition, reproduced, method, chosen);
        // Data, size and number of scenes may be the same.
        if runs.len() > 1 {
            let presets = distinct(chosen.iter().flatten().map(|(part, _)| part.preset.name.as_str())).join(", ");
            for row in &mut own {
                row.remarks.push(format!("under {presets}"));
            }
        }
        rows.extend(own);
    }
    rows
}

/// The results that fill each group of columns, once for each row of the method.
fn runs<'a>(
    definition: &TableDefinition,
    edition: &'a Edition<'a>,
    row: Option<&RowDefinition>,
    method: Option<Candidate<'_>>,
) -> Vec<Vec<Option<(&'a Part<'a>, &'a MethodRecord)>>> {
    let of_group = |group: &ColumnGroup| -> Vec<(&'a Part<'a>, &'a MethodRecord)> {
        let preset = row.and_then(|row| row.preset.as_deref()).or(group.preset.as_deref());
        let is_own = |part: &&Part<'_>| {
            Some(part.preset.published()) == preset && method.is_none_or(|method| method.store == part.source.label)
        };
        let run = |part: &'a Part<'a>| {
            let results = part.source.results;
            let ran = |record: &&MethodRecord| has_trials(results, &part.preset.name, &record.name);
            let mut records = results.provenance.methods.iter().filter(ran);
            let record = match method {
                Some(method) => records.find(|record| record.name == method.record.name),
                None => records.find(|record| group.method.as_ref().is_some_and(|rule| rule.accepts(record))),
            };
            Some((part, record?))
        };
        edition.parts.iter().filter(is_own).filter_map(run).collect()
    };
    let found: Vec<_> = definition.groups.iter().map(of_group).collect();
    // Where each group has its own method, the first that was run fills it.
    let most = if method.is_some() { usize::MAX } else { 1 };
    let count = found.iter().map(Vec::len).max().unwrap_or_default().min(most);
    (0..count).map(|at| found.iter().map(|own| own.get(at).copied()).collect()).collect()
}

/// A measured row, followed by the same without leaked targets if there are any.
fn measured_once(
    definition: &TableDefinition,
    edition: &Edition<'_>,
    reproduced: Option<(usize, &PublishedRow, &RowDefinition)>,
    method: Option<Candidate<'_>>,
    chosen: &[Option<(&Part<'_>, &MethodRecord)>],
) -> Vec<Row> {
    let cells_of = |leaked| -> Vec<Vec<Cell>> {
        let groups = definition.groups.iter().zip(chosen).map(|(group, chosen)| match chosen {
            Some((part, record)) => cells(part, &record.name, group, leaked, edition.forced),
            None => vec![Cell::default(); group.columns.len()],
        });
        groups.collect()
    };
    let ran: Vec<ProtocolRun<'_>> = definition
        .groups
        .iter()
        .zip(chosen)
        .filter_map(|(group, chosen)| {
            let (part, record) = chosen.as_ref()?;
            Some(ProtocolRun { heading: &group.title, part, method: &record.name })
        })
        .collect();
    let titles = distinct(chosen.iter().flatten().map(|(_, record)| record.title.as_str()));
    // A row with the labels of a published row would not name its method otherwise.
    let by_setting = definition.measured_label == MeasuredLabel::Published && reproduced.is_some();
    let measured_on = MeasuredOn::of(&ran, by_setting.then(|| titles.join(" and ")));
    let protocols: Vec<Option<StoreProtocol>> = chosen
        .iter()
        .map(|own| own.map(|(part, record)| part.store_protocol(&record.name, remarks(edition, part, record))))
        .collect();
    let row = |leaked: Leaked| Row {
        labels: settings(definition, &ran, labels(definition, edition, reproduced.map(|(_, row, _)| row), method)),
        measured_on: Some(measured_on.clone()),
        remarks: remarks_of_row(&protocols, leaked),
        origin: Origin::Measured,
        answers: reproduced.map(|(at, _, _)| at),
        method: method.map(|method| method.record.name.clone()),
        store: chosen.iter().flatten().next().map(|(part, _)| part.source.label.to_owned()),
        protocols: protocols.clone(),
        trainings: Vec::new(),
        untrained: chosen.iter().flatten().any(|(_, record)| record.untrained),
        inference_only: chosen.iter().flatten().any(|(_, record)| is_inference_only(edition, record)),
        not_retrained: chosen.iter().flatten().any(|(_, record)| is_not_retrained(edition, record)),
        without_leaked: leaked == Leaked::Excluded,
        rule_above: false,
        cells: cells_of(leaked),
    };
    let mut columns = definition.groups.iter().flat_map(|group| &group.columns);
    let has_metrics = columns.any(|column| matches!(column.quantity, Quantity::Metric(_)));
    let leaked = has_metrics && chosen.iter().flatten().any(|(part, record)| has_leaked(part, &record.name));
    let mut rows = vec![row(Leaked::Included)];
    if leaked {
        rows.push(row(Leaked::Excluded));
    }
    rows
}

/// What the label of a measured row has to add: the remarks on its methods, and on its targets.
fn remarks_of_row(protocols: &[Option<StoreProtocol>], leaked: Leaked) -> Vec<String> {
    let of_methods = protocols.iter().flatten().flat_map(|own| &own.remarks).cloned();
    distinct(of_methods.chain((leaked == Leaked::Excluded).then(|| WITHOUT_LEAKED.to_owned())))
}

/// What the name of a method has to add under a protocol.
fn remarks(edition: &Edition<'_>, part: &Part<'_>, record: &MethodRecord) -> Vec<String> {
    let untrained = (record.untrained && !record.title.contains("untrained")).then(|| "untrained".to_owned());
    let thresholds = by_quantile(record).map(|thresholds| format!("thresholds {thresholds}"));
    let inference_only = is_inference_only(edition, record).then(|| INFERENCE_ONLY.to_owned());
    let unseen = zero_shot_note(record, &part.protocol.dataset);
    [untrained, unseen, thresholds, inference_only].into_iter().flatten().collect()
}

/// Remark on a row that shares its weights with another row and differs at inference.
const INFERENCE_ONLY: &str = "changed at inference only";
/// Remark on a row without the targets that are also context frames.
pub(crate) const WITHOUT_LEAKED: &str = "without context frames";

/// Labels that print the published data or size say what was measured instead.
fn settings(definition: &TableDefinition, ran: &[ProtocolRun<'_>], labels: Vec<String>) -> Vec<String> {
    let Some(first) = ran.first().filter(|_| definition.measured_label == MeasuredLabel::Published) else {
        return labels;
    };
    let own = definition.labels.iter().zip(labels).map(|(column, label)| match column.text.as_str() {
        "{dataset}" => first.part.data(),
        "{height}×{width}" => first.part.size(first.method).unwrap_or(label),
        _ => label,
    });
    own.collect()
}

/// The labels of a measured row; methods with the same title are distinguished by name and store.
fn labels(
    definition: &TableDefinition,
    edition: &Edition<'_>,
    reproduced: Option<&PublishedRow>,
    method: Option<Candidate<'_>>,
) -> Vec<String> {
    let mut labels = vec![String::new(); definition.labels.len()];
    let Some(method) = method else { return reproduced.map_or(labels, |row| row.labels.clone()) };
    let all = all_methods(edition);
    let named = |name: Option<&str>| {
        let twin = |other: &&Candidate<'_>| {
            other.record.title == method.record.title && name.is_none_or(|name| other.record.name == name)
        };
        all.iter().filter(twin).count()
    };
    let twins = named(None) > 1;
    let name = match (twins, named(Some(&method.record.name)) > 1) {
        (false, _) => String::new(),
        (true, false) => format!(" ({})", method.record.name),
        (true, true) => format!(" ({}: {})", method.store, method.record.name),
    };
    match (definition.measured_label, reproduced) {
        (MeasuredLabel::Published, Some(row)) => {
            labels.clone_from(&row.labels);
            if let Some(last) = labels.last_mut() {
                last.push_str(&name);
            }
        }
        _ => {
            if let Some(first) = labels.first_mut() {
                *first = format!("{}{name}", method.record.title);
            }
        }
    }
    labels
}
