use std::collections::{BTreeMap, BTreeSet};

use atsplat_eval::store::Unfinished;
use atsplat_eval::{MethodRecord, PresetRecord, Results};
use atsplat_protocol::{OverlapBins, Preset};

use super::{Row, Source, StoreProtocol};
use crate::definition::TableDefinition;
use crate::{ReportError, counted};

/// Results that may share a table: one protocol and one index for each preset.
#[derive(Debug, Default)]
pub(super) struct Edition<'a> {
    suffix: Option<&'a str>,
    pub(super) parts: Vec<Part<'a>>,
    /// Whether protocols differ nevertheless.
    pub(super) mixed: bool,
    /// Whether `--force` allowed results that do not belong together.
    pub(super) forced: bool,
    /// Why its results are not in the table of an edition before it.
    pub(super) apart: Option<String>,
}

/// One preset of one store.
#[derive(Clone, Debug)]
pub(super) struct Part<'a> {
    pub(super) source: Source<'a>,
    pub(super) preset: &'a PresetRecord,
    /// The protocol that the record contains as text.
    pub(super) protocol: Preset,
    /// For each method with rows whose run is unfinished, how far it got.
    pub(super) unfinished: Vec<String>,
}

/// The editions of a definition: results join the first edition that they are consistent with. `mix` puts all into one.
///
/// # Errors
/// [`ReportError::Store`] for a record with an invalid protocol.
pub(super) fn editions<'a>(
    definition: &TableDefinition,
    sources: &[Source<'a>],
    mix: bool,
) -> Result<Vec<Edition<'a>>, ReportError> {
    let needed = definition.presets();
    let mut editions: Vec<Edition<'a>> = Vec::new();
    for source in sources {
        let own = source.results.provenance.presets.iter().filter(|record| needed.contains(&record.published()));
        let own: Vec<&PresetRecord> = own.collect();
        let interrupted = if own.is_empty() { Vec::new() } else { source.results.interrupted() };
        let parts = own.into_iter().map(|preset| {
            let unfinished = unfinished(preset, &interrupted);
            Ok(Part { source: *source, preset, protocol: preset.protocol()?, unfinished })
        });
        for (suffix, parts) in consistent_groups(parts.collect::<Result<_, ReportError>>()?) {
            let fits = editions.iter().position(|edition| edition.fits(suffix, &parts));
            let at = match fits {
                Some(at) => at,
                None if mix && !editions.is_empty() => 0,
                None => {
                    let mut before = editions.iter().filter(|edition| edition.suffix == Some(suffix));
                    let apart = before.find_map(|edition| edition.why_apart(&parts));
                    editions.push(Edition { suffix: Some(suffix), forced: mix, apart, ..Edition::default() });
                    editions.len() - 1
                }
            };
            let edition = &mut editions[at];
            edition.mixed |= fits.is_none() && !edition.parts.is_empty();
            edition.parts.extend(parts);
        }
    }
    Ok(editions)
}

fn unfinished(preset: &PresetRecord, interrupted: &[Unfinished]) -> Vec<String> {
    let own = interrupted.iter().filter(|run| run.preset == preset.name);
    let text = |Unfinished { preset, method, entries, total, .. }: &Unfinished| {
        format!("{preset}: the run is unfinished: {entries} of {total} entries under {method}")
    };
    own.map(text).collect()
}

/// Whether the trials that two stores have in common, each under a preset of this name, read the same images and cameras.
pub(crate) fn is_same_data(stores: [(&Results, &str); 2]) -> bool {
    other_data(stores).is_empty()
}

/// Scene and entry of the trials that two stores have in common, but with other images or cameras.
fn other_data<'a>(stores: [(&'a Results, &str); 2]) -> Vec<(&'a str, u32)> {
    let [own, others] = stores.map(|(results, preset)| {
        let trials = results.trials.iter().filter(|trial| trial.key.preset == preset);
        trials
            .filter_map(|trial| Some(((trial.key.scene.as_str(), trial.key.entry), trial.data_hash.as_deref()?)))
            .collect::<BTreeMap<_, _>>()
    });
    let differ = |(trial, data): &(&(&str, u32), &&str)| own.get(*trial).is_some_and(|known| known != *data);
    others.iter().filter(differ).map(|(trial, _)| *trial).collect()
}

/// The parts of a store by suffix; parts of one suffix that may not share an edition are in groups of their own.
fn consistent_groups<'a>(parts: Vec<Part<'a>>) -> Vec<(&'a str, Vec<Part<'a>>)> {
    let mut groups: Vec<(&'a str, Vec<Part<'a>>)> = Vec::new();
    for part in parts {
        let suffix = suffix_of(part.preset);
        let fits = groups
            .iter()
            .position(|(own, others)| *own == suffix && others.iter().all(|other| other.is_consistent_with(&part)));
        match fits {
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
    let own = record.name.strip_prefix(record.preset.as_str()).unwrap_or("");
    if record.stands_for.is_some() && own.is_empty() { "simulated" } else { own }
}

impl Edition<'_> {
    fn fits(&self, suffix: &str, parts: &[Part<'_>]) -> bool {
        let is_consistent = |part: &Part<'_>| self.parts.iter().all(|own| own.is_consistent_with(part));
        self.suffix == Some(suffix) && parts.iter().all(is_consistent)
    }

    /// Why parts do not share this edition's table; `None` if they may.
    fn why_apart(&self, parts: &[Part<'_>]) -> Option<String> {
        parts.iter().find_map(|part| self.parts.iter().find_map(|own| part.why_apart(own)))
    }

    /// The method of a measured row under a preset; `None` if the row has no results of it.
    pub(super) fn method(&self, preset: &str, row: &Row) -> Option<(&Part<'_>, &MethodRecord)> {
        let mut measured = self.parts.iter().filter(|part| row.protocols.iter().flatten().any(|own| part.is(own)));
        let part = measured.find(|part| part.preset.published() == preset)?;
        let records = &part.source.results.provenance.methods;
        Some((part, records.iter().find(|record| Some(&record.name) == row.method.as_ref())?))
    }

    /// Names of the presets that were run in place of a published preset, or of any; `None` if all were run as published in these
    /// rows.
    pub(super) fn other_setting(&self, preset: Option<&str>, rows: &[Row]) -> Option<String> {
        let of_preset = |part: &&Part<'_>| preset.is_none_or(|preset| part.preset.published() == preset);
        let is_other = |part: &&Part<'_>| part.difference(&part.methods_in(rows)).is_some();
        let others = self.parts.iter().filter(of_preset).filter(is_other);
        let name = |part: &Part<'_>| {
            let index = part.alternative_index().map(|index| format!(" with the index {}", index.name));
            format!("{}{}", part.preset.name, index.unwrap_or_default())
        };
        let names: BTreeSet<String> = others.map(name).collect();
        (!names.is_empty()).then(|| Vec::from_iter(names).join(", "))
    }
}

impl Part<'_> {
    /// Whether its results may share a table with those of another: both are of different published presets, or of one
    /// protocol, index, and set of images and cameras.
    pub(super) fn is_consistent_with(&self, other: &Part<'_>) -> bool {
        self.why_apart(other).is_none()
    }

    /// Why its results may not share a table with those of another; `None` if they may.
    fn why_apart(&self, other: &Part<'_>) -> Option<String> {
        let (own, others) = (self.preset, other.preset);
        if own.published() != others.published() {
            return None;
        }
        let why = if own.hash != others.hash {
            "its protocol is another one".to_owned()
        } else if own.index_sha256 != others.index_sha256 {
            "its index is another one".to_owned()
        } else {
            let differ = other_data([self, other].map(|part| (part.source.results, part.preset.name.as_str())));
            let (scene, entry) = differ.first()?;
            let trials = counted(differ.len() as u64, "trial");
            format!("{trials} that both have read other images or cameras, first scene {scene}, entry {entry}")
        };
        Some(format!("{}: not in one table with the results of {}: {why}", own.name, other.source.label))
    }

    /// Whether it is the protocol that was measured.
    pub(super) fn is(&self, protocol: &StoreProtocol) -> bool {
        protocol.store == self.source.label && protocol.preset == self.preset.name
    }

    /// Its names in rows of tables, with the method that was measured and the remarks on it.
    pub(super) fn store_protocol(&self, method: &str, remarks: Vec<String>) -> StoreProtocol {
        let (store, preset) = (self.source.label.to_owned(), self.preset.name.clone());
        StoreProtocol { store, preset, method: method.to_owned(), remarks }
    }

    /// [`Self::mismatched_overlaps`] for the preset's own bins.
    pub(super) fn forced_overlaps(&self) -> Option<String> {
        self.mismatched_overlaps(self.protocol.overlap_bins.as_ref()?)
    }

    /// Why its overlaps do not belong in `bins`; `None` if they do.
    pub(super) fn mismatched_overlaps(&self, bins: &OverlapBins) -> Option<String> {
        let found = bins.mismatched_estimator(&self.preset.overlap_estimators)?;
        let published = bins.estimator().unwrap_or("one estimator");
        Some(format!("{}: overlaps are measured by {found}, the bins were published for {published}", self.preset.name))
    }
}
