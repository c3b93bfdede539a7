use std::collections::{BTreeMap, BTreeSet};

use atsplat_eval::{MethodRecord, PresetRecord};
use atsplat_protocol::{OverlapBins, Preset};

use super::{Row, Source};
use crate::ReportError;
use crate::definition::TableDefinition;

/// Results that may share a table: one protocol and one index for each preset.
#[derive(Debug, Default)]
pub(super) struct Edition<'a> {
    identities: BTreeMap<&'a str, Identity<'a>>,
    suffix: Option<&'a str>,
    pub(super) parts: Vec<Part<'a>>,
    /// Whether protocols differ nevertheless.
    pub(super) mixed: bool,
    /// Whether `--force` allowed results that do not belong together.
    pub(super) forced: bool,
}

/// One preset of one store.
#[derive(Clone, Debug)]
pub(super) struct Part<'a> {
    pub(super) source: Source<'a>,
    pub(super) preset: &'a PresetRecord,
    /// The protocol that the record contains as text.
    pub(super) protocol: Preset,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Identity<'a> {
    hash: &'a str,
    index: &'a str,
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
        let mut by_suffix: BTreeMap<&str, Vec<&PresetRecord>> = BTreeMap::new();
        for record in own {
            by_suffix.entry(suffix_of(record)).or_default().push(record);
        }
        for (suffix, records) in by_suffix {
            let fits = editions.iter().position(|edition| edition.fits(suffix, *source, &records));
            let at = match fits {
                Some(at) => at,
                None if mix && !editions.is_empty() => 0,
                None => {
                    editions.push(Edition { suffix: Some(suffix), forced: mix, ..Edition::default() });
                    editions.len() - 1
                }
            };
            let edition = &mut editions[at];
            edition.mixed |= fits.is_none() && !edition.parts.is_empty();
            for preset in records {
                edition.identities.entry(preset.published()).or_insert_with(|| Identity::of(preset));
                edition.parts.push(Part { source: *source, preset, protocol: preset.protocol()? });
            }
        }
    }
    Ok(editions)
}

/// What distinguishes results of one preset that do not share a table: the dataset appended to its name, or that it only
/// stands for the published preset.
fn suffix_of(record: &PresetRecord) -> &str {
    let own = record.name.strip_prefix(record.preset.as_str()).unwrap_or("");
    if record.stands_for.is_some() && own.is_empty() { "simulated" } else { own }
}

impl Edition<'_> {
    fn fits(&self, suffix: &str, source: Source<'_>, records: &[&PresetRecord]) -> bool {
        let same = |record: &&PresetRecord| {
            self.identities.get(record.published()).is_none_or(|known| *known == Identity::of(record))
                && self.parts.iter().all(|part| part.has_same_data(source, record))
        };
        self.suffix == Some(suffix) && records.iter().all(same)
    }

    /// The method of a measured row under a preset.
    pub(super) fn method(&self, preset: &str, row: &Row) -> Option<(&Part<'_>, &MethodRecord)> {
        let own =
            |part: &&Part<'_>| part.preset.published() == preset && Some(part.source.label) == row.store.as_deref();
        let part = self.parts.iter().find(own)?;
        let records = &part.source.results.provenance.methods;
        Some((part, records.iter().find(|record| Some(&record.name) == row.method.as_ref())?))
    }

    /// Names of the presets that were run in place of a published preset, or of any; `None` if all were run as published.
    pub(super) fn other_setting(&self, preset: Option<&str>) -> Option<String> {
        let of_preset = |part: &&Part<'_>| preset.is_none_or(|preset| part.preset.published() == preset);
        let others = self.parts.iter().filter(of_preset).filter(|part| part.difference().is_some());
        let names: BTreeSet<&str> = others.map(|part| part.preset.name.as_str()).collect();
        (!names.is_empty()).then(|| Vec::from_iter(names).join(", "))
    }
}

/// The data hashes of the trials that have one, by scene and entry.
fn data_hashes<'a>(source: Source<'a>, record: &PresetRecord) -> BTreeMap<(&'a str, u32), &'a str> {
    let trials = source.results.trials.iter().filter(|trial| trial.key.preset == record.name);
    trials
        .filter_map(|trial| Some(((trial.key.scene.as_str(), trial.key.entry), trial.data_hash.as_deref()?)))
        .collect()
}

impl<'a> Identity<'a> {
    fn of(record: &'a PresetRecord) -> Self {
        Self { hash: &record.hash, index: &record.index_sha256 }
    }
}

impl Part<'_> {
    /// Whether the trials that this and another store have in common read the same pictures and cameras.
    fn has_same_data(&self, source: Source<'_>, record: &PresetRecord) -> bool {
        if record.published() != self.preset.published() {
            return true;
        }
        let own = data_hashes(self.source, self.preset);
        data_hashes(source, record).iter().all(|(trial, data)| own.get(trial).is_none_or(|known| known == data))
    }

    /// [`Self::foreign_overlaps`] for the preset's own bins.
    pub(super) fn forced_overlaps(&self) -> Option<String> {
        self.foreign_overlaps(self.protocol.overlap_bins.as_ref()?)
    }

    /// Why its overlaps do not belong in `bins`; `None` if they do.
    pub(super) fn foreign_overlaps(&self, bins: &OverlapBins) -> Option<String> {
        let found = bins.foreign(&self.preset.overlap_estimators)?;
        let published = bins.estimator().unwrap_or("one estimator");
        Some(format!("{}: overlaps are measured by {found}, the bins were published for {published}", self.preset.name))
    }

    /// How it differs from the published setting; `None` if it does not.
    pub(super) fn difference(&self) -> Option<String> {
        let record = self.preset;
        if let Some(published) = &record.stands_for {
            return Some(format!("{} stands for {published}: compare the order and the gaps of rows", record.name));
        }
        if self.protocol.index.accepted.is_empty() {
            return Some(format!("{}: no published protocol ({})", record.name, record.dataset));
        }
        if record.index_name.is_none() {
            return Some(format!("{}: the index is not a published one ({})", record.name, record.dataset));
        }
        if record.entries < record.entries_of_index {
            return Some(format!(
                "{}: {} of {} index entries were run",
                record.name, record.entries, record.entries_of_index
            ));
        }
        self.is_changed().then(|| format!("{}: the preset was changed", record.name))
    }

    /// Whether the preset differs from the built-in one of its name.
    pub(super) fn is_changed(&self) -> bool {
        let known = Preset::named(&self.preset.preset).and_then(|preset| preset.hash());
        !known.is_ok_and(|hash| hash.to_string() == self.preset.hash)
    }
}
