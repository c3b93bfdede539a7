use std::collections::{BTreeMap, BTreeSet};

use atsplat_eval::PresetRecord;
use atsplat_protocol::{OverlapBins, Preset};

use super::Source;
use crate::definition::TableDefinition;

/// Results that may share a table: of each preset, one protocol and one index.
#[derive(Debug, Default)]
pub(super) struct Edition<'a> {
    identities: BTreeMap<&'a str, Identity<'a>>,
    suffix: Option<&'a str>,
    pub(super) parts: Vec<Part<'a>>,
    /// Whether protocols differ all the same.
    pub(super) mixed: bool,
    /// Whether results stand where they do not belong because that was asked for.
    pub(super) forced: bool,
}

/// One preset of one store.
#[derive(Clone, Copy, Debug)]
pub(super) struct Part<'a> {
    pub(super) source: Source<'a>,
    pub(super) preset: &'a PresetRecord,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Identity<'a> {
    hash: &'a str,
    index: &'a str,
}

/// The editions of a definition: results join the first one that they do not contradict. `mix` puts all into one.
pub(super) fn editions<'a>(definition: &TableDefinition, sources: &[Source<'a>], mix: bool) -> Vec<Edition<'a>> {
    let wanted = presets(definition);
    let mut editions: Vec<Edition<'a>> = Vec::new();
    for source in sources {
        let own = source.results.provenance.presets.iter().filter(|record| wanted.contains(&record.published()));
        let mut by_suffix: BTreeMap<&str, Vec<&PresetRecord>> = BTreeMap::new();
        for record in own {
            by_suffix.entry(suffix_of(record)).or_default().push(record);
        }
        for (suffix, records) in by_suffix {
            let fits = editions.iter().position(|edition| edition.fits(suffix, &records));
            let at = match fits {
                Some(at) => at,
                None if mix && !editions.is_empty() => 0,
                None => {
                    editions.push(Edition { suffix: Some(suffix), forced: mix, ..Edition::default() });
                    editions.len() - 1
                }
            };
            let Some(edition) = editions.get_mut(at) else { continue };
            edition.mixed |= fits.is_none() && !edition.parts.is_empty();
            for preset in records {
                edition.identities.entry(preset.published()).or_insert_with(|| Identity::of(preset));
                edition.parts.push(Part { source: *source, preset });
            }
        }
    }
    editions
}

/// What tells apart results of one preset that share no table: the dataset that was added to its name, or that it only
/// stands for the published one.
fn suffix_of(record: &PresetRecord) -> &str {
    let own = record.name.strip_prefix(record.preset.as_str()).unwrap_or("");
    if record.stands_for.is_some() && own.is_empty() { "simulated" } else { own }
}

/// Every preset that a definition asks for.
pub(super) fn presets(definition: &TableDefinition) -> Vec<&str> {
    let groups = definition.groups.iter().filter_map(|group| group.preset.as_deref());
    groups.chain(definition.rows.iter().filter_map(|row| row.preset.as_deref())).collect()
}

impl Edition<'_> {
    fn fits(&self, suffix: &str, records: &[&PresetRecord]) -> bool {
        let same = |record: &&PresetRecord| {
            self.identities.get(record.published()).is_none_or(|known| *known == Identity::of(record))
        };
        self.suffix == Some(suffix) && records.iter().all(same)
    }

    /// Names of what was run in place of a published preset, or of any; `None` where all is as published.
    pub(super) fn other_setting(&self, preset: Option<&str>) -> Option<String> {
        let asked = |part: &&Part<'_>| preset.is_none_or(|preset| part.preset.published() == preset);
        let others = self.parts.iter().filter(asked).filter(|part| part.difference().is_some());
        let names: BTreeSet<&str> = others.map(|part| part.preset.name.as_str()).collect();
        (!names.is_empty()).then(|| Vec::from_iter(names).join(", "))
    }
}

impl<'a> Identity<'a> {
    fn of(record: &'a PresetRecord) -> Self {
        Self { hash: &record.hash, index: &record.index_sha256 }
    }
}

impl Part<'_> {
    /// The same of the preset's own bins.
    pub(super) fn forced_overlaps(&self) -> Option<String> {
        self.foreign_overlaps(&Preset::from_toml(&self.preset.toml).ok()?.overlap_bins?)
    }

    /// Why its overlaps do not belong into `bins`; `None` where they do.
    pub(super) fn foreign_overlaps(&self, bins: &OverlapBins) -> Option<String> {
        let found = bins.foreign(&self.preset.overlap_estimators)?;
        let published = bins.estimator().unwrap_or("one estimator");
        Some(format!("{}: overlaps are measured by {found}, the bins were published for {published}", self.preset.name))
    }

    /// Why its numbers are not of the published setting; `None` where they are.
    pub(super) fn difference(&self) -> Option<String> {
        let record = self.preset;
        if let Some(published) = &record.stands_for {
            return Some(format!("{} stands for {published}: compare the order and the gaps of rows", record.name));
        }
        if record.index_name.is_none() {
            return Some(format!("{}: the index is no published one ({})", record.name, record.dataset));
        }
        if record.entries < record.entries_of_index {
            return Some(format!(
                "{}: {} of {} index entries were run",
                record.name, record.entries, record.entries_of_index
            ));
        }
        let known = Preset::named(&record.preset).and_then(|preset| preset.hash());
        let same = known.is_ok_and(|hash| hash.to_string() == record.hash);
        (!same).then(|| format!("{}: the preset was changed", record.name))
    }
}
