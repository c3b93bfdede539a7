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
    /// Entries that are binned although it is unknown by which estimator their overlap was measured.
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

#[cfg(test)]
mod tests {
    use super::*;

    /// Stores have these texts: by another one, the entries of older stores would no longer be gaps.
    #[test]
    fn texts_of_stores_stay() {
        let stored = [
            (ForeignEntries::TargetsAreInputs, "entries whose targets are all context frames"),
            (
                ForeignEntries::TargetsOutside,
                "entries with every target outside the window, under a protocol of targets inside it",
            ),
            (
                ForeignEntries::TargetsInside,
                "entries with targets inside the window, under a protocol of targets outside it",
            ),
            (
                ForeignEntries::UnknownEstimator,
                "entries whose overlap does not say how it was measured, under bins of one estimator",
            ),
        ];
        for (kind, text) in stored {
            assert_eq!((kind.to_string().as_str(), ForeignEntries::of(text)), (text, Some(kind)));
        }
        let all = ForeignEntries::deserialize(StrDeserializer::<Error>::new("none")).unwrap_err().to_string();
        let listed = stored.map(|(_, text)| format!("`{text}`")).join(", ");
        assert_eq!(all, format!("unknown variant `none`, expected one of {listed}"), "every kind has its text here");
    }
}
