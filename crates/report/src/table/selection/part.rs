//! The results of one store under one preset, and whether those of another belong in one table with them.

use atsplat_protocol::{OverlapBins, Preset};
use atsplat_results::{MethodRecord, PresetRecord};

use super::known_dataset::in_words;
use super::trial_data::trials_of_other_data;
use super::{MethodRun, has_trials};
use crate::counted;
use crate::table::{Source, StoreProtocol};

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
