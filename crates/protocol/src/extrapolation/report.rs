use std::fmt;

use serde::Serialize;

use super::TargetDistances;
use crate::EvaluationIndex;

/// An extrapolation index and how it was derived. Counts are of entries (one per scene in every published DL3DV
/// index), except for `null_scenes`.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct ExtrapolationReport {
    /// The new index: shifted context frames, and ascending targets outside the window.
    #[serde(skip)]
    pub index: EvaluationIndex,
    /// Scenes without an entry in the original index.
    pub null_scenes: usize,
    /// Windows of the original index that start at frame 0.
    pub started_at_zero: usize,
    /// Windows shifted towards the end.
    pub shifted_later: usize,
    /// Windows shifted towards the start.
    pub shifted_earlier: usize,
    /// Entries with all `2 · margin` targets.
    pub complete: usize,
    /// Entries that keep fewer targets ([`super::Incomplete::Clip`]).
    pub clipped: Vec<String>,
    /// Entries dropped because the scene is known to be shorter than window and margins, by scene key.
    pub too_short: Vec<String>,
    /// Entries dropped because there are too few frames before an unshifted window.
    pub no_room_before: Vec<String>,
    /// Entries dropped because there are too few frames after an unshifted window or, in a scene of unknown length,
    /// before [`crate::IndexEntry::MAX_FRAME`].
    pub no_room_after: Vec<String>,
    /// Entries dropped because frames have no image file or no usable pose, although the scene has room for them.
    pub without_image: Vec<String>,
    /// Entries dropped because a context frame lies outside the scene, or there is no context frame.
    pub invalid: Vec<String>,
    /// Entries of scenes of unknown length, which count as long enough.
    pub length_unknown: usize,
    /// Frames of the index's scenes without an image file or a usable pose, which are no targets.
    pub missing_images: usize,
    /// Targets of the new index by signed distance from their window.
    pub targets_by_distance: TargetDistances,
}

impl ExtrapolationReport {
    /// Number of dropped entries, for any reason.
    pub fn dropped(&self) -> usize {
        self.drops().into_iter().map(|(_, scenes)| scenes.len()).sum()
    }

    /// Why entries were dropped, with the scene of each.
    pub const fn drops(&self) -> [(&'static str, &[String]); 5] {
        [
            ("scene too short", self.too_short.as_slice()),
            ("no room before the window", self.no_room_before.as_slice()),
            ("no room after the window", self.no_room_after.as_slice()),
            ("frames without an image", self.without_image.as_slice()),
            ("frames outside the scene", self.invalid.as_slice()),
        ]
    }
}

impl fmt::Display for ExtrapolationReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let kept = [
            ("null scenes", self.null_scenes),
            ("windows that start at frame 0", self.started_at_zero),
            ("windows shifted later", self.shifted_later),
            ("windows shifted earlier", self.shifted_earlier),
            ("entries with every target", self.complete),
            ("entries clipped", self.clipped.len()),
        ];
        for (what, count) in kept {
            writeln!(f, "{count:>7}  {what}")?;
        }
        for (why, scenes) in self.drops() {
            writeln!(f, "{:>7}  entries dropped, {why}", scenes.len())?;
        }
        writeln!(f, "{:>7}  entries whose scene length is unknown", self.length_unknown)?;
        writeln!(f, "{:>7}  frames without an image or a usable pose, which are not selected", self.missing_images)?;
        writeln!(f, "targets by distance: {}", self.targets_by_distance)
    }
}
