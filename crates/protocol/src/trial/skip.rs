use std::collections::BTreeMap;
use std::fmt;

use serde::{Serialize, Serializer};

use crate::preset::{DropReason, Dropped};

/// Why an index entry gives no trial.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
#[non_exhaustive]
pub enum SkipReason {
    /// The index has `null` for the scene.
    NullEntry,
    /// A reason for which the published loaders drop it too.
    Dropped(DropReason),
    /// A frame has no usable pose: it is not finite or not a rotation.
    PoseUnusable,
    /// An image's header cannot be read, or states a size beyond the limits of decoding.
    ImageUnreadable,
    /// An image does not match its camera's intrinsics.
    ImageMisfit,
    /// A preprocessing step does not fit the image.
    Preprocessing,
    /// The pose normalisation is not defined for these cameras.
    PoseNormalisation,
    /// The entry has no target, where [`super::Trials::requiring_targets`] asks for one.
    NoTargets,
}

impl SkipReason {
    /// The reason's stable name.
    pub const fn name(self) -> &'static str {
        match self {
            Self::NullEntry => "null-entry",
            Self::Dropped(reason) => reason.name(),
            Self::PoseUnusable => "pose-unusable",
            Self::ImageUnreadable => "image-unreadable",
            Self::ImageMisfit => "image-misfit",
            Self::Preprocessing => "preprocessing",
            Self::PoseNormalisation => "pose-normalisation",
            Self::NoTargets => "no-targets",
        }
    }
}

impl Serialize for SkipReason {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.serialize_str(self.name())
    }
}

/// Why an entry gives no trial, without its position in an index.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Rejection {
    /// The reason.
    pub reason: SkipReason,
    /// Frame, limit and value, or the error's text.
    pub detail: String,
    /// Position of the frame that is rejected; `None` for what is wrong with the entry as a whole, and for filters.
    pub frame: Option<usize>,
}

impl Rejection {
    /// That of an entry without targets.
    pub(super) fn of_no_targets() -> Self {
        let detail = "field target: expected at least one frame, found none".to_owned();
        Self { reason: SkipReason::NoTargets, detail, frame: None }
    }
}

impl From<Dropped> for Rejection {
    fn from(Dropped { reason, detail }: Dropped) -> Self {
        Self { reason: SkipReason::Dropped(reason), detail, frame: None }
    }
}

/// An index entry that gives no trial.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct Skipped {
    /// Key of the scene.
    pub scene: String,
    /// Position of the entry in the scene's list; 0 for a `null`.
    pub entry_number: usize,
    /// The reason.
    pub reason: SkipReason,
    /// Frame, limit and value, or the error's text.
    pub detail: String,
    /// That of the [`Rejection`].
    #[serde(skip)]
    pub frame: Option<usize>,
}

impl fmt::Display for Skipped {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { scene, entry_number, reason, detail, frame: _ } = self;
        write!(f, "scene {scene:?}, entry {entry_number}: {}: {detail}", reason.name())
    }
}

/// The outcome of an index's entries so far.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct SkipReport {
    /// Number of entries that gave a trial.
    pub trials: usize,
    /// Entries that did not, in index order; `null` scenes first.
    pub skipped: Vec<Skipped>,
}

impl SkipReport {
    /// Number of skipped entries by reason.
    pub fn counts(&self) -> BTreeMap<SkipReason, usize> {
        let mut counts = BTreeMap::new();
        for skipped in &self.skipped {
            *counts.entry(skipped.reason).or_default() += 1;
        }
        counts
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The page lists each reason once, in order.
    #[test]
    fn documented() {
        let page = include_str!("../../../../docs/warnings.md");
        let listed = page.lines().skip_while(|line| *line != "| reason | what was found |").skip(2);
        let listed: Vec<&str> = listed.map_while(|line| line.strip_prefix("| `")?.split('`').next()).collect();
        let of_entries = [
            SkipReason::PoseUnusable,
            SkipReason::ImageUnreadable,
            SkipReason::ImageMisfit,
            SkipReason::Preprocessing,
            SkipReason::PoseNormalisation,
            SkipReason::NoTargets,
        ];
        let reasons =
            [SkipReason::NullEntry].into_iter().chain(DropReason::ALL.map(SkipReason::Dropped)).chain(of_entries);
        let names: Vec<&str> = reasons.map(SkipReason::name).collect();
        assert_eq!(listed, names);
    }
}
