//! Which results share a table: for each preset those of one protocol, one index, and one set of images and cameras.

use atsplat_results::PresetRecord;
use atsplat_results::store::Unfinished;

use super::known_dataset::known_dataset;
use super::{MethodRun, Part, StoreMethod};
use crate::ReportError;
use crate::definition::{Choice, TableDefinition};
use crate::table::{Row, Source, StoreProtocol, Table};

/// Results that may share a table.
#[derive(Debug)]
pub(in crate::table) struct ComparableResults<'a> {
    suffix: &'a str,
    pub(in crate::table) parts: Vec<Part<'a>>,
    /// Whether protocols differ nevertheless.
    pub(in crate::table) mixed: bool,
    /// Whether `--force` allowed results that do not belong together.
    pub(in crate::table) forced: bool,
    /// Why these results are not in the table of an earlier group.
    pub(in crate::table) separated_because: Option<String>,
    /// What the definition shows of them.
    pub(in crate::table) choice: Choice,
}

/// The groups of results for a definition, each for one table: results join the first group that they are comparable with.
/// `mix` puts all into one.
///
/// # Errors
/// [`ReportError::Store`] for a record with an invalid protocol.
pub(in crate::table) fn comparable_groups<'a>(
    definition: &TableDefinition,
    sources: &[Source<'a>],
    mix: bool,
) -> Result<Vec<ComparableResults<'a>>, ReportError> {
    let needed = definition.presets();
    let mut groups: Vec<ComparableResults<'a>> = Vec::new();
    for source in sources {
        for (suffix, parts) in by_suffix(parts_of(*source, &needed)?) {
            let fitting = groups.iter().position(|group| group.fits(suffix, &parts));
            let at = match fitting {
                Some(at) => at,
                None if mix && !groups.is_empty() => 0,
                None => {
                    let mut earlier = groups.iter().filter(|group| group.suffix == suffix);
                    let separated_because = earlier.find_map(|group| group.why_not_comparable(&parts));
                    groups.push(ComparableResults {
                        suffix,
                        parts: Vec::new(),
                        mixed: false,
                        forced: mix,
                        separated_because,
                        choice: definition.choice.clone(),
                    });
                    groups.len() - 1
                }
            };
            let group = &mut groups[at];
            group.mixed |= fitting.is_none() && !group.parts.is_empty();
            group.parts.extend(parts);
        }
    }
    Ok(groups)
}

/// The results of a store under the presets that a table needs.
fn parts_of<'a>(source: Source<'a>, needed: &[&str]) -> Result<Vec<Part<'a>>, ReportError> {
    let presets = source.results.provenance.presets.iter();
    let presets: Vec<&'a PresetRecord> = presets.filter(|preset| needed.contains(&preset.published())).collect();
    let interrupted = if presets.is_empty() { Vec::new() } else { source.results.interrupted() };
    presets
        .into_iter()
        .map(|preset| {
            let unfinished = unfinished(preset, &interrupted);
            let dataset = known_dataset(source.results, preset);
            Ok(Part { source, preset, protocol: preset.protocol()?, dataset, unfinished })
        })
        .collect()
}

fn unfinished(preset: &PresetRecord, interrupted: &[Unfinished]) -> Vec<String> {
    let runs = interrupted.iter().filter(|run| run.preset == preset.name);
    let text = |Unfinished { preset, method, entries, total, .. }: &Unfinished| {
        format!("{preset}: the run is unfinished: {entries} of {total} entries under {method}")
    };
    runs.map(text).collect()
}

/// The parts of a store by suffix; parts of one suffix that are not comparable are in different groups.
fn by_suffix<'a>(parts: Vec<Part<'a>>) -> Vec<(&'a str, Vec<Part<'a>>)> {
    let mut groups: Vec<(&'a str, Vec<Part<'a>>)> = Vec::new();
    for part in parts {
        let suffix = suffix_of(part.preset);
        let fitting = groups
            .iter()
            .position(|(known, others)| *known == suffix && others.iter().all(|other| other.is_comparable_with(&part)));
        match fitting {
            Some(at) => groups[at].1.push(part),
            None => groups.push((suffix, vec![part])),
        }
    }
    groups.sort_by_key(|(suffix, _)| *suffix);
    groups
}

/// What distinguishes results of one preset that do not share a table: the dataset appended to its name, or that it only
/// stands in for the published preset.
fn suffix_of(record: &PresetRecord) -> &str {
    let suffix = record.name.strip_prefix(record.preset.as_str()).unwrap_or("");
    if record.stands_for.is_some() && suffix.is_empty() { "simulated" } else { suffix }
}

impl ComparableResults<'_> {
    fn fits(&self, suffix: &str, parts: &[Part<'_>]) -> bool {
        self.suffix == suffix && self.why_not_comparable(parts).is_none()
    }

    /// Why parts may not share the table of these results; `None` if they may.
    fn why_not_comparable(&self, parts: &[Part<'_>]) -> Option<String> {
        parts.iter().find_map(|part| self.parts.iter().find_map(|known| part.why_not_comparable(known)))
    }

    /// What was measured under a protocol; `None` if these results do not have it.
    pub(in crate::table) fn run_of(&self, protocol: &StoreProtocol) -> Option<MethodRun<'_>> {
        let part = self.parts.iter().find(|part| part.is(protocol))?;
        Some(MethodRun { part, record: part.source.results.provenance.method(&protocol.method)? })
    }

    /// What was measured for a group of columns of a row: one method, or every training.
    pub(in crate::table) fn runs_of_group(&self, row: &Row, group: usize) -> Vec<MethodRun<'_>> {
        row.measured(group).into_iter().filter_map(|protocol| self.run_of(protocol)).collect()
    }

    /// The method of a measured row under a preset; `None` if the row has no results of it.
    pub(in crate::table) fn run_under(&self, preset: &str, row: &Row) -> Option<MethodRun<'_>> {
        let is_of_row = |part: &&Part<'_>| row.protocols.iter().flatten().any(|protocol| part.is(protocol));
        let mut measured = self.parts.iter().filter(is_of_row);
        let part = measured.find(|part| part.preset.published() == preset)?;
        Some(MethodRun { part, record: part.source.results.provenance.method(row.method.as_deref()?)? })
    }

    /// The chosen methods of each store, each once, in the order of the choice.
    pub(in crate::table) fn store_methods(&self) -> Vec<StoreMethod<'_>> {
        let mut methods: Vec<StoreMethod<'_>> = Vec::new();
        for Part { source, .. } in &self.parts {
            for record in &source.results.provenance.methods {
                let method = StoreMethod { store: source.label, record };
                if self.place_of(method).is_some() && !methods.iter().any(|known| known.is(method)) {
                    methods.push(method);
                }
            }
        }
        methods.sort_by_key(|method| self.place_of(*method));
        methods
    }

    /// The methods in a table.
    pub(in crate::table) fn methods_in(&self, table: &Table) -> Vec<MethodRun<'_>> {
        // A row whose groups of columns have different methods has no method as a whole.
        let shown: Vec<&StoreProtocol> = table.rows.iter().flat_map(|row| row.protocols.iter().flatten()).collect();
        let methods = self.parts.iter().flat_map(|part| {
            part.source.results.provenance.methods.iter().map(move |record| MethodRun { part, record })
        });
        methods
            .filter(|run| shown.iter().any(|protocol| run.part.is(protocol) && protocol.method == run.record.name))
            .collect()
    }
}
