//! What readers of results must know about an index: irregularities of its file, and what a generated index leaves out.

use std::collections::BTreeMap;

use atsplat_protocol::extrapolation::ExtrapolationReport;
use atsplat_protocol::{BuiltIndex, IndexFile, Preset};
use atsplat_results::RunWarning;
use atsplat_scene::{WarningKind, Warnings};

const REJECTED_ENTRY: &str = "sampled entries rejected for their overlap";
const REPEATED_IMAGE: &str = "frames that repeat an earlier frame's image file, which are not sampled";

/// Irregularities of an index of one kind.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct IndexNotice {
    /// How often it occurs in the whole index.
    pub count: u64,
    /// The first of them.
    pub example: String,
    /// What a run misses because of them.
    pub missing: Missing,
}

/// What a run misses because of a notice.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Missing {
    /// Nothing.
    Nothing,
    /// Entries of a published index that have no trial.
    Entries,
    /// Scenes or frames of the data that a sampled index leaves out.
    Data,
}

/// Notices by kind.
pub(super) type Notices = BTreeMap<String, IndexNotice>;

/// Irregularities of an index file that is none of the preset's own.
pub(super) fn of_file(file: &IndexFile, preset: &Preset) -> Notices {
    let IndexFile { index, notices, .. } = file;
    let found = [
        notices.unknown_fields_mismatch(),
        notices.unscored_targets_mismatch(),
        notices.overlap_words_mismatch(),
        preset.unusual_target_counts(index),
    ];
    let found = found.into_iter().flatten();
    let notice = |count, example| IndexNotice { count, example, missing: Missing::Nothing };
    found.map(|found| (found.kind, notice(found.count, found.example))).collect()
}

/// Entries that a split drops from an index, by reason.
pub(super) fn of_split(split: &ExtrapolationReport, is_published: bool) -> Notices {
    let notice = |(why, scenes): (&str, &[String])| {
        let (kind, missing) = if is_published {
            (RunWarning::DroppedBySplit.about(why), Missing::Entries)
        } else {
            (format!("sampled entries that have no place in the split: {why}"), Missing::Nothing)
        };
        let example = scenes.first()?.clone();
        Some((kind, IndexNotice { count: scenes.len() as u64, example, missing }))
    };
    split.drops().into_iter().filter_map(notice).collect()
}

/// What a rule left out: scenes and frames that it could not use, and entries that it rejects by itself.
pub(super) fn of_sampling(built: &BuiltIndex, unreadable_images: u64, rule: &str) -> Notices {
    let first_null = built.index.scenes.iter().find(|(_, entries)| entries.is_empty());
    let nulls = first_null.map(|(key, _)| {
        let (count, example) = (built.nulls.values().sum::<usize>() as u64, format!("{key}, …: {}", reasons(built)));
        (RunWarning::WithoutEntry.to_string(), IndexNotice { count, example, missing: Missing::Data })
    });
    let others = [
        (REJECTED_ENTRY.to_owned(), built.rejected_entries as u64, Missing::Nothing),
        (RunWarning::WithoutImage.to_string(), built.missing_images as u64, Missing::Data),
        (REPEATED_IMAGE.to_owned(), built.repeated_images as u64, Missing::Nothing),
        (RunWarning::UnreadableImage.to_string(), unreadable_images, Missing::Data),
    ]
    .map(|(kind, count, missing)| (kind, IndexNotice { count, example: rule.to_owned(), missing }));
    nulls.into_iter().chain(others).filter(|(_, notice)| notice.count > 0).collect()
}

/// Scenes that were not read when the data were opened, by the warnings of opening: a sampler did not see them.
pub(super) fn of_unread(opening: &Warnings) -> Notices {
    const UNREAD: [WarningKind; 3] =
        [WarningKind::UnreadableScene, WarningKind::SceneNotFound, WarningKind::IgnoredScene];
    let unread = opening.summary().filter(|(kind, ..)| UNREAD.contains(kind));
    let notice = |count, example| IndexNotice { count, example, missing: Missing::Data };
    let of_kind = |kind: WarningKind| RunWarning::NotRead.about(&kind.to_string());
    unread.map(|(kind, count, first)| (of_kind(kind), notice(count, first.to_string()))).collect()
}

/// Numbers of scenes without an entry, by reason.
pub(super) fn reasons(built: &BuiltIndex) -> String {
    let reasons: Vec<String> = built.nulls.iter().map(|(reason, scenes)| format!("{scenes} {reason}")).collect();
    reasons.join(", ")
}
