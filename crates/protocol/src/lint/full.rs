use std::fmt;

use serde::Serialize;

use super::display::phrase;
use super::{Comparability, DatasetFacts, LintReport, TableSharing};
use crate::{IndexFile, IndexMatch, IndexMismatch, Preset};

/// A [`LintReport`], how the index fits a preset, and whether its results compare with those of a second one.
#[derive(Debug, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct FullLint<'a> {
    /// The index alone, and its dataset.
    #[serde(flatten)]
    pub lint: LintReport,
    /// How it fits a preset.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub preset: Option<PresetMatch<'a>>,
    /// Whether results on a second index compare.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub against: Option<Comparability>,
}

/// How an index fits a preset.
#[derive(Debug, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct PresetMatch<'a> {
    /// Name of the preset.
    pub name: &'a str,
    /// Which of its indices it is.
    #[serde(flatten)]
    pub index: IndexMatch<'a>,
    /// How it does not fit.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub mismatches: Vec<IndexMismatch>,
}

impl<'a> PresetMatch<'a> {
    /// How the index of a file fits a preset.
    pub fn new(preset: &'a Preset, file: &IndexFile) -> Self {
        let index = preset.index.recognise(file);
        let mut mismatches = preset.mismatches(&file.index, &file.sha256);
        if is_none_of_its_own(index) {
            mismatches.extend(preset.misplaced_targets(&file.index));
            mismatches.extend(preset.unusual_target_counts(&file.index));
            if file.recognised().is_none() {
                mismatches.extend(preset.foreign_overlaps(&file.index, &file.index.overlap_estimators()));
            }
        }
        mismatches.extend(file.notices.unknown_fields_mismatch());
        Self { name: &preset.name, index, mismatches }
    }
}

/// Whether an index is neither one of a preset's files nor derived from one of them as a whole.
const fn is_none_of_its_own(index: IndexMatch<'_>) -> bool {
    matches!(index, IndexMatch::DerivedFromOther { .. } | IndexMatch::Unpublished)
}

impl FullLint<'_> {
    /// What makes the index unfit for an evaluation, with counts; empty if nothing does.
    ///
    /// An index without entries has nothing to evaluate. Leaks and repetitions count as faults unless the index is official or
    /// named by the preset. Targets outside the window, `null` scenes and, without a preset, unknown fields never do.
    pub fn faults(&self) -> Vec<String> {
        let mut faults = Vec::new();
        if self.lint.entries == 0 {
            faults.push("no scene has an entry".to_owned());
        }
        let counts = self.counts().into_iter().filter(|(count, _)| *count > 0);
        faults.extend(counts.map(|(count, what)| phrase(count, what)));
        let mismatches = self.preset.iter().flat_map(|preset| &preset.mismatches);
        faults.extend(mismatches.map(|IndexMismatch { kind, count, .. }| format!("{count} {kind}")));
        let different = self.against.iter().filter(|against| against.table_sharing == TableSharing::Different);
        faults.extend(different.map(|against| against.table_sharing.to_string()));
        faults
    }

    /// Counts of faults, zeros included, with phrases for one and for several.
    fn counts(&self) -> Vec<(u64, [&'static str; 2])> {
        let lint = &self.lint;
        let mut counts = Vec::new();
        if !self.is_published() {
            counts.push((lint.leaked.targets, LintReport::LEAKED));
            counts.extend(lint.odd_entries());
        }
        let (file, dataset) = (lint.file.as_ref(), lint.dataset.as_ref());
        let leaked_images = dataset.map_or(0, |dataset| dataset.leaked_images);
        let repeated_keys = file.map_or(0, |file| file.notices.duplicate_keys.len() as u64);
        let dropped: u64 = dataset.map_or(0, |dataset| dataset.dropped.values().sum());
        counts.extend([
            (leaked_images, DatasetFacts::LEAKED_IMAGES),
            (repeated_keys, ["repeated scene key", "repeated scene keys"]),
            (dropped, ["entry gives no trial on the dataset", "entries give no trial on the dataset"]),
        ]);
        counts
    }

    fn is_published(&self) -> bool {
        let by_preset = |preset: &PresetMatch<'_>| !is_none_of_its_own(preset.index);
        self.lint.recognised.is_some() || self.preset.as_ref().is_some_and(by_preset)
    }
}

impl fmt::Display for FullLint<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}", self.lint)?;
        if let Some(PresetMatch { name, index, mismatches }) = &self.preset {
            writeln!(f, "\npreset {name}: {index}")?;
            for IndexMismatch { kind, count, example } in mismatches {
                writeln!(f, "    does not fit: {count} {kind}: {example}")?;
            }
        }
        if let Some(against) = &self.against {
            write!(f, "\nagainst the second index\n{against}")?;
        }
        Ok(())
    }
}
