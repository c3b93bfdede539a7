//! How what was run differs from the published setting.

use std::collections::BTreeSet;

use atsplat_numeric::distinct;
use atsplat_protocol::trial::SkipReason;
use atsplat_protocol::{AcceptedIndex, DropReason, PoseNormalisation, Preset};
use atsplat_results::{PresetRecord, SkippedEntry};

use super::{ComparableResults, Part};
use crate::table::Row;

impl ComparableResults<'_> {
    /// Names of the presets that were run in place of a published preset, or of any; `None` if all were run as published in these
    /// rows.
    pub(in crate::table) fn other_setting(&self, preset: Option<&str>, rows: &[Row]) -> Option<String> {
        let of_preset = |part: &&Part<'_>| preset.is_none_or(|preset| part.preset.published() == preset);
        let is_other = |part: &&Part<'_>| part.difference_from_published(&part.methods_in(rows)).is_some();
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
    /// How the results of these methods differ from the published setting; `None` if they do not. Other methods may have trials where
    /// these have none.
    pub(in crate::table) fn difference_from_published(&self, methods: &[&str]) -> Option<String> {
        let record = self.preset;
        if let Some(published) = &record.stands_for {
            return Some(format!(
                "{} stands in for {published} with other scenes: compare rankings and gaps, not values",
                record.name
            ));
        }
        if self.protocol.index.accepted.is_empty() {
            return Some(format!("{}: not a published protocol ({})", record.name, record.dataset));
        }
        if record.index_name.is_none() {
            return Some(format!("{}: the index is not a published one ({})", record.name, record.dataset));
        }
        if let Some(AcceptedIndex { name, note, .. }) = self.alternative_index() {
            let note = note.as_deref().unwrap_or("not the protocol's default");
            return Some(format!("{}: the index {name}: {note}", record.name));
        }
        if record.entries < record.entries_of_index {
            return Some(format!(
                "{}: {} of {} index entries were run",
                record.name, record.entries, record.entries_of_index
            ));
        }
        if let Some(unfinished) = self.unfinished.first() {
            return Some(unfinished.clone());
        }
        let other = || Some(format!("{}: {}", record.name, OtherPreset::of(record)?.in_words()));
        self.without_trial(methods).or_else(other)
    }

    /// The published index that it was run on, if that is not the protocol's default.
    pub(in crate::table) fn alternative_index(&self) -> Option<&AcceptedIndex> {
        self.protocol.index.alternative(self.preset.index_name.as_ref()?)
    }

    /// How many entries have no trial under these methods, although the published loaders would have used them.
    fn without_trial(&self, methods: &[&str]) -> Option<String> {
        let record = self.preset;
        let is_lost = |entry: &&SkippedEntry| {
            entry.preset == record.name
                && methods.iter().any(|method| entry.concerns(method))
                && !is_published(&self.protocol, &entry.reason)
        };
        let lost: Vec<&SkippedEntry> = self.source.results.provenance.skipped.iter().filter(is_lost).collect();
        let first = lost.first()?;
        let count = lost.iter().map(|entry| (entry.scene.as_str(), entry.entry)).collect::<BTreeSet<_>>().len();
        let is_of = |method: &&&str| lost.iter().any(|entry| entry.concerns(method));
        let lacking: Vec<&str> = methods.iter().filter(is_of).copied().collect();
        let under =
            if lacking.len() < methods.len() { format!(" under {}", lacking.join(", ")) } else { String::new() };
        Some(format!(
            "{}: {count} of {} index entries {} no trial{under}: {}",
            record.name,
            record.entries_of_index,
            if count == 1 { "has" } else { "have" },
            first.reason
        ))
    }

    /// The methods that rows of a table measured under it.
    pub(in crate::table) fn methods_in<'a>(&self, rows: &'a [Row]) -> Vec<&'a str> {
        let protocols = rows.iter().flat_map(|row| row.protocols.iter().flatten());
        distinct(protocols.filter(|protocol| self.is(protocol)).map(|protocol| protocol.method.as_str()))
    }
}

/// A preset that is not a built-in one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum OtherPreset {
    /// It has the name of a built-in one, and another content.
    Changed,
    /// No built-in one has its name.
    Own,
}

impl OtherPreset {
    /// What a preset is; `None` for a built-in one.
    pub(crate) fn of(record: &PresetRecord) -> Option<Self> {
        let Ok(known) = Preset::named(&record.preset) else { return Some(Self::Own) };
        let is_same = known.hash().is_ok_and(|hash| hash.to_string() == record.hash);
        (!is_same).then_some(Self::Changed)
    }

    pub(crate) const fn in_words(self) -> &'static str {
        match self {
            Self::Changed => "protocol changed",
            Self::Own => "own protocol",
        }
    }
}

/// Whether published numbers are without the entries that were skipped for this reason: by a `null` in the index, or by a filter on
/// cameras that the protocol states. Images of another size, or that cannot be read, are those of local data.
fn is_published(protocol: &Preset, reason: &str) -> bool {
    let filters = &protocol.filters;
    let stated = [
        (SkipReason::NullEntry, true),
        (SkipReason::Dropped(DropReason::FieldOfView), filters.max_fov_degrees.is_some()),
        (SkipReason::Dropped(DropReason::Determinant), filters.determinant),
        (SkipReason::Dropped(DropReason::Translation), filters.max_translation.is_some()),
        (SkipReason::Dropped(DropReason::Baseline), limits_baseline(protocol)),
    ];
    stated.into_iter().any(|(known, is_stated)| is_stated && known.name() == reason)
}

/// Whether the protocol states limits of the baseline, by itself or for one of its methods.
fn limits_baseline(protocol: &Preset) -> bool {
    fn divides_by_it(rule: &PoseNormalisation) -> bool {
        match rule {
            PoseNormalisation::BaselineOne { .. } | PoseNormalisation::MaxPairwise { .. } => true,
            PoseNormalisation::Sequence { steps } => steps.iter().any(divides_by_it),
            _ => false,
        }
    }
    let filters = &protocol.filters;
    let mut rules = protocol.methods.iter().map(|setting| &setting.pose_normalisation);
    filters.min_baseline.is_some()
        || filters.max_baseline.is_some()
        || divides_by_it(&protocol.pose_normalisation)
        || rules.any(divides_by_it)
}
