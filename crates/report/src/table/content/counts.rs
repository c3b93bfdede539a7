//! How many scenes and targets a number is over, in numbers and in words.

use serde::Serialize;

use super::{Cell, Trainings};
use crate::counted;

/// The numbers of scenes and targets behind a mean; behind a mean over several trainings, the targets of all of them.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct Counts {
    /// Scenes in the mean.
    pub scenes: u64,
    /// Targets in the mean.
    pub targets: u64,
    /// Targets whose render is identical to the truth; not in the mean.
    pub identical: u64,
    /// Targets without a render or a truth.
    pub failed: u64,
    /// Targets of trials that the method does not support.
    #[serde(skip_serializing_if = "is_zero")]
    pub not_applicable: u64,
    /// Targets whose score is not finite.
    pub non_finite: u64,
    /// Targets whose score was not computed; not in the mean.
    #[serde(skip_serializing_if = "is_zero")]
    pub uncomputed: u64,
    /// Scored targets of the row without an overlap, or with one outside all bins, if the mean is over a bin.
    #[serde(skip_serializing_if = "is_zero")]
    pub outside_bins: u64,
}

/// Whether a file leaves the count out.
#[expect(clippy::trivially_copy_pass_by_ref, reason = "serde passes references")]
pub(in crate::table) const fn is_zero(count: &u64) -> bool {
    *count == 0
}

impl Counts {
    /// Whether targets of its row are not in the mean for want of a score.
    pub(crate) const fn lacks_targets(self) -> bool {
        self.failed + self.not_applicable + self.non_finite + self.uncomputed > 0
    }

    /// Its targets without a score, each kind with its number: `, 3 failed and not in the mean`.
    pub(crate) fn without_score(self, and: &str) -> String {
        let Self { failed, not_applicable, non_finite, .. } = self;
        let kinds = [(failed, "failed"), (not_applicable, "not applicable"), (non_finite, "not finite")];
        let missing = kinds.into_iter().filter(|(count, _)| *count > 0);
        missing.map(|(count, what)| format!(", {count} {what} and {and}")).collect()
    }
}

impl Cell {
    /// The scenes and targets of its mean, and the targets that are not in it; `None` if it is not a mean.
    pub(crate) fn counts_in_words(&self) -> Option<String> {
        let counts = self.counts?;
        let mut text = format!("{}, {}", counted(counts.scenes, "scene"), counted(counts.targets, "target"));
        if let Some(Trainings { count, .. }) = self.trainings {
            text.push_str(&format!(" of {count} trainings"));
        }
        text.push_str(&counts.without_score("not in the mean"));
        if counts.identical > 0 {
            text.push_str(&format!(", {} more identical to the truth and left out", counts.identical));
        }
        Some(text)
    }
}
