//! What a report on expansion lacks of its protocol: everything that makes `--strict` fail.

use std::collections::BTreeMap;
use std::fmt;

use atsplat_protocol::trial::Skipped;
use atsplat_results::RunWarning;
use serde::Serialize;

use crate::runner::{Dataset, Missing, Selection};

/// Scenes, frames or index entries that are not in an [`ExpansionReport`](super::ExpansionReport).
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct ExpansionGap {
    /// What is missing.
    pub kind: String,
    /// Number of cases.
    pub count: u64,
    /// The first case.
    pub first: String,
}

impl ExpansionGap {
    /// What a dataset lacks before a trial is read, whatever the limit: scenes of its index, and what a sampled index or a derived
    /// split leaves out.
    pub fn of_dataset(dataset: &Dataset, selection: Selection) -> Vec<Self> {
        let missing = selection.missing_in(dataset);
        let scenes = missing.first().map(|first| Self {
            kind: RunWarning::MissingScenes.to_string(),
            count: missing.len() as u64,
            first: first.clone(),
        });
        let notices = dataset.index.notices.iter().filter(|(_, notice)| notice.missing != Missing::Nothing);
        let of_index = notices.map(|(kind, notice)| Self {
            kind: kind.clone(),
            count: notice.count,
            first: notice.example.clone(),
        });
        scenes.into_iter().chain(of_index).collect()
    }

    /// Index entries without a trial, by reason.
    pub fn of_skipped(skipped: &[Skipped]) -> Vec<Self> {
        let mut gaps: BTreeMap<&str, Self> = BTreeMap::new();
        for entry in skipped {
            let reason = entry.reason.name();
            let first = || Self {
                kind: format!("index entries that were skipped: {reason}"),
                count: 0,
                first: format!("scene {}, entry {}: {}", entry.scene, entry.entry_number, entry.detail),
            };
            gaps.entry(reason).or_insert_with(first).count += 1;
        }
        gaps.into_values().collect()
    }
}

impl fmt::Display for ExpansionGap {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} {}: {}", self.count, self.kind, self.first)
    }
}

#[cfg(test)]
mod tests {
    use atsplat_protocol::trial::SkipReason;

    use super::*;

    #[test]
    fn skipped_entries_are_counted_by_reason_with_the_first() {
        let skipped = [
            ("x", 1, SkipReason::ImageUnreadable, "frame 3"),
            ("y", 0, SkipReason::ImageMisfit, "frame 5"),
            ("z", 2, SkipReason::ImageUnreadable, "frame 7"),
        ];
        let skipped = skipped.map(|(scene, entry_number, reason, detail)| Skipped {
            scene: scene.to_owned(),
            entry_number,
            reason,
            detail: detail.to_owned(),
            frame: None,
        });
        let lines: Vec<String> = ExpansionGap::of_skipped(&skipped).iter().map(ToString::to_string).collect();
        let expected = [
            "1 index entries that were skipped: image-misfit: scene y, entry 0: frame 5",
            "2 index entries that were skipped: image-unreadable: scene x, entry 1: frame 3",
        ];
        assert_eq!(lines, expected);
    }
}
