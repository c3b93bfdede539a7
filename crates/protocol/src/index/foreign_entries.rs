use std::fmt;

use serde::de::value::{Error, StrDeserializer};
use serde::{Deserialize, Serialize};

/// A kind of entries of an index that is none of the preset's own, whose numbers are not those that the preset's name promises.
///
/// Its text is the [`super::IndexMismatch::kind`] of [`crate::Preset::misplaced_targets`] and [`crate::Preset::foreign_overlaps`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
pub enum ForeignEntries {
    /// Entries that every method can copy.
    #[serde(rename = "entries whose targets are all context frames")]
    TargetsAreInputs,
    /// Entries without an interpolated target under a protocol of interpolation.
    #[serde(rename = "entries with every target outside the window, under a protocol of targets inside it")]
    TargetsOutside,
    /// Entries with interpolated targets under a protocol of extrapolation.
    #[serde(rename = "entries with targets inside the window, under a protocol of targets outside it")]
    TargetsInside,
    /// Entries that are binned although nobody knows what their overlap is.
    #[serde(rename = "entries whose overlap does not say how it was measured, under bins of one estimator")]
    UnknownEstimator,
}

impl ForeignEntries {
    /// The kind of this text; `None` for others.
    pub fn of(kind: &str) -> Option<Self> {
        Self::deserialize(StrDeserializer::<Error>::new(kind)).ok()
    }
}

impl fmt::Display for ForeignEntries {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.serialize(f)
    }
}
