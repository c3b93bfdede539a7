use serde::Serialize;

use super::TargetDistances;
use crate::EvaluationIndex;

/// An extrapolation index and how it came about. Counts are entries (one a scene in every published DL3DV
/// index), but for `null_scenes`.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct ExtrapolationReport {
    /// The new index: contexts moved, targets outside the window, ascending.
    #[serde(skip)]
    pub index: EvaluationIndex,
    /// Scenes that had no entry in the first place.
    pub null_scenes: usize,
    /// Windows of the given index that start at frame 0.
    pub started_at_zero: usize,
    /// Windows moved towards the end.
    pub shifted_later: usize,
    /// Windows moved towards the start.
    pub shifted_earlier: usize,
    /// Entries with all `2 · margin` targets.
    pub complete: usize,
    /// Entries that keep fewer targets ([`super::Incomplete::Clip`]).
    pub clipped: Vec<String>,
    /// Entries left out because the scene is known to be shorter than window and margins, by scene key.
    pub too_short: Vec<String>,
    /// Entries left out because a window that stays where it is has too few frames before it.
    pub no_room_before: Vec<String>,
    /// Entries left out because too few frames come after a window that stays where it is, or after one of a
    /// scene of unknown length before [`crate::IndexEntry::MAX_FRAME`].
    pub no_room_after: Vec<String>,
    /// Entries left out because a context frame lies outside the scene, or there is none.
    pub invalid: Vec<String>,
    /// Entries of scenes whose length nobody gave; they count as long enough.
    pub length_unknown: usize,
    /// Targets of the new index by signed distance outside their window.
    pub targets_by_distance: TargetDistances,
}

impl ExtrapolationReport {
    /// How many entries were left out, for any cause.
    pub fn left_out(&self) -> usize {
        [&self.too_short, &self.no_room_before, &self.no_room_after, &self.invalid].into_iter().map(Vec::len).sum()
    }
}
