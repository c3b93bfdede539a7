//! Which results share a table: for each preset those of one protocol, one index, and one set of images and cameras.

use atsplat_metrics::Definition;
use atsplat_protocol::{OverlapBins, Preset};
use atsplat_results::statistics::{Identical, Leaked, MetricQuery};
use atsplat_results::store::Unfinished;
use atsplat_results::{MethodRecord, PresetRecord, Results, TargetRow, TrialRow};

use super::has_trials;
use super::known_dataset::{in_words, known_dataset};
use super::trial_data::trials_of_other_data;
use crate::definition::{Choice, TableDefinition};
use crate::table::{Row, Source, StoreProtocol, Table};
use crate::{ReportError, counted};

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

/// The results of one store under one preset.
#[derive(Clone, Debug)]
pub(in crate::table) struct Part<'a> {
    pub(in crate::table) source: Source<'a>,
    pub(in crate::table) preset: &'a PresetRecord,
    /// The protocol that the record contains as text.
    pub(in crate::table) protocol: Preset,
    /// Id of the dataset that its data are known to be of.
    pub(in crate::table) dataset: Option<String>,
    /// For each method with rows whose run is unfinished, how far it got.
    pub(in crate::table) unfinished: Vec<String>,
}

/// A method under one preset of one store.
#[derive(Clone, Copy, Debug)]
pub(in crate::table) struct MethodRun<'a> {
    pub(in crate::table) part: &'a Part<'a>,
    pub(in crate::table) record: &'a MethodRecord,
}

/// A method of a store.
#[derive(Clone, Copy, Debug)]
pub(in crate::table) struct StoreMethod<'a> {
    pub(in crate::table) store: &'a str,
    pub(in crate::table) record: &'a MethodRecord,
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

impl Part<'_> {
    /// Whether its results may share a table with those of another: both are of different published presets, or of one
    /// protocol, index, and set of images and cameras.
    pub(in crate::table) fn is_comparable_with(&self, other: &Part<'_>) -> bool {
        self.why_not_comparable(other).is_none()
    }

    /// Why its results may not share a table with those of another; `None` if they may.
    pub(super) fn why_not_comparable(&self, other: &Part<'_>) -> Option<String> {
        let (record, known) = (self.preset, other.preset);
        if record.published() != known.published() {
            return None;
        }
        let why = if record.hash != known.hash {
            "the protocols differ".to_owned()
        } else if record.index_sha256 != known.index_sha256 {
            "the indices differ".to_owned()
        } else {
            let differing =
                trials_of_other_data([self, other].map(|part| (part.source.results, part.preset.name.as_str())));
            let (scene, entry) = differing.first()?;
            let trials = counted(differing.len() as u64, "trial");
            format!("{trials} that both have read different images or cameras, first scene {scene}, entry {entry}")
        };
        Some(format!("{}: not in one table with the results of {}: {why}", record.name, other.source.label))
    }

    /// The data in words.
    pub(in crate::table) fn data(&self) -> String {
        in_words(self.dataset.as_deref(), &self.protocol.dataset, &self.preset.dataset)
    }

    /// Whether it is the protocol that was measured.
    pub(in crate::table) fn is(&self, protocol: &StoreProtocol) -> bool {
        protocol.store == self.source.label && protocol.preset == self.preset.name
    }

    /// [`Self::mismatched_overlaps`] for the bins of the preset.
    pub(in crate::table) fn forced_overlaps(&self) -> Option<String> {
        self.mismatched_overlaps(self.protocol.overlap_bins.as_ref()?)
    }

    /// Why its overlaps do not belong in `bins`; `None` if they do.
    pub(in crate::table) fn mismatched_overlaps(&self, bins: &OverlapBins) -> Option<String> {
        let found = bins.mismatched_estimator(&self.preset.overlap_estimators)?;
        let published = bins.estimator().unwrap_or("one estimator");
        Some(format!("{}: overlaps are measured by {found}, the bins were published for {published}", self.preset.name))
    }
}

impl<'a> Part<'a> {
    /// The first such method that was run under the preset.
    pub(in crate::table) fn first_run(&'a self, is_wanted: impl Fn(&MethodRecord) -> bool) -> Option<MethodRun<'a>> {
        let results = self.source.results;
        let mut records = results.provenance.methods.iter();
        let record =
            records.find(|record| is_wanted(record) && has_trials(results, &self.preset.name, &record.name))?;
        Some(MethodRun { part: self, record })
    }
}

impl StoreMethod<'_> {
    /// Whether it is the method of the same name in the same store.
    pub(in crate::table) fn is(self, other: StoreMethod<'_>) -> bool {
        self.store == other.store && self.record.name == other.record.name
    }
}

impl<'a> MethodRun<'a> {
    /// All results of its store.
    pub(in crate::table) fn results(self) -> &'a Results {
        self.part.source.results
    }

    /// Name of the preset in rows.
    pub(in crate::table) fn preset_name(self) -> &'a str {
        &self.part.preset.name
    }

    /// Name of the method in rows.
    pub(in crate::table) fn method_name(self) -> &'a str {
        &self.record.name
    }

    /// Its trials.
    pub(in crate::table) fn trials(self) -> impl Iterator<Item = &'a TrialRow> {
        self.results().trials_of(self.preset_name(), self.method_name())
    }

    /// Its targets.
    pub(in crate::table) fn targets(self) -> impl Iterator<Item = &'a TargetRow> {
        self.results().targets_of(self.preset_name(), self.method_name())
    }

    /// A metric over targets, without renders that are identical to the truth.
    pub(in crate::table) fn query(self, metric: &'static Definition, leaked: Leaked) -> MetricQuery<'a> {
        let identical = Identical::Excluded;
        MetricQuery { preset: self.preset_name(), method: self.method_name(), metric: metric.id, leaked, identical }
    }

    /// The results of its store, and a metric over all of its targets in them.
    pub(in crate::table) fn over_all_targets(self, metric: &'static Definition) -> (&'a Results, MetricQuery<'a>) {
        (self.results(), self.query(metric, Leaked::Included))
    }

    /// Its names in rows of tables, with the remarks on it.
    pub(in crate::table) fn store_protocol(self, remarks: Vec<String>) -> StoreProtocol {
        let [store, preset, method] =
            [self.part.source.label, self.preset_name(), self.method_name()].map(str::to_owned);
        StoreProtocol { store, preset, method, remarks }
    }
}
