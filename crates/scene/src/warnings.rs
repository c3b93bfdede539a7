use std::collections::BTreeMap;
use std::fmt;

use serde::Serialize;

/// What can be wrong with part of a dataset without stopping the rest of it.
///
/// Ordered and named for reports: the kebab-case name is stable and goes into JSON and the results
/// store. Kinds about pictures count frames, all others count scenes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize)]
#[serde(rename_all = "kebab-case")]
#[non_exhaustive]
pub enum WarningKind {
    /// A frame is listed but its picture file is not there.
    MissingPicture,
    /// A picture was found under another extension or folder than the one written down.
    PictureElsewhere,
    /// A frame's pose or intrinsics are unusable.
    BadCamera,
    /// A camera lies so far from the origin that its numbers are more likely broken than a place.
    DistantCamera,
    /// The rotation part deviates from a rotation by more than `numpy.allclose` allows.
    ImperfectRotation,
    /// Two frames carry the same timestamp.
    DuplicateTimestamp,
    /// Timestamps do not increase.
    UnorderedTimestamps,
    /// Opening angle above 100°, which pixelSplat's loader drops in silence.
    WideFieldOfView,
    /// The principal point is off the centre by more than 1e-3, which symmetric renderers ignore.
    OffCentrePrincipalPoint,
    /// The lens distorts and the protocol's renderer does not.
    LensDistortion,
    /// A picture's size is not the one that the metadata or the protocol states, or its pixels are not square.
    UnexpectedSize,
    /// A picture's EXIF says that it is to be turned or mirrored, which is not done: the field's loaders do not either.
    TurnedPicture,
    /// Two scenes of a dataset have the same key; the first is used.
    DuplicateScene,
    /// A scene could not be read at all.
    UnreadableScene,
    /// The index names a scene that the dataset does not hold.
    SceneNotFound,
    /// Numbered pictures fit a trajectory both counted from 0 and from 1, or neither way; or two have one number.
    AmbiguousNumbering,
    /// A chunk lies beside an index that names none of its scenes.
    UnindexedChunk,
    /// A picture's header cannot be read.
    UnreadablePicture,
}

/// One observation about one place in a dataset.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Warning {
    /// What kind of problem.
    pub kind: WarningKind,
    /// Scene key, or the file where no scene is known yet.
    pub scene: String,
    /// Where and what exactly: line, field, expected, found.
    pub detail: String,
}

/// Collects what is wrong without stopping: passed down as a parameter, counted by kind, printed and
/// stored at the end.
///
/// Every warning is counted; only the first [`Warnings::KEPT_PER_KIND`] of a kind keep their detail,
/// so that a broken dataset of ten thousand scenes stays readable.
#[derive(Clone, Debug, Default)]
pub struct Warnings {
    counts: BTreeMap<WarningKind, u64>,
    kept: Vec<Warning>,
}

impl Warnings {
    /// How many warnings of a kind keep their detail.
    pub const KEPT_PER_KIND: u64 = 20;

    /// An empty collection.
    pub fn new() -> Self {
        Self::default()
    }

    /// Counts one warning.
    pub fn push(&mut self, kind: WarningKind, scene: impl Into<String>, detail: impl Into<String>) {
        let count = self.counts.entry(kind).or_default();
        *count += 1;
        if *count <= Self::KEPT_PER_KIND {
            self.kept.push(Warning { kind, scene: scene.into(), detail: detail.into() });
        }
    }

    /// Takes over another collection's warnings, as if they had been pushed here.
    pub fn merge(&mut self, other: Self) {
        for (kind, count) in other.counts {
            *self.counts.entry(kind).or_default() += count;
        }
        for warning in other.kept {
            let held = self.kept.iter().filter(|w| w.kind == warning.kind).count() as u64;
            if held < Self::KEPT_PER_KIND {
                self.kept.push(warning);
            }
        }
    }

    /// Leaves out what is about pictures, for whoever uses cameras alone.
    #[must_use]
    pub fn about_cameras(mut self) -> Self {
        self.counts.retain(|kind, _| !kind.is_about_pictures());
        self.kept.retain(|warning| !warning.kind.is_about_pictures());
        self
    }

    /// Counts by kind, in the kinds' order.
    pub fn counts(&self) -> impl Iterator<Item = (WarningKind, u64)> {
        self.counts.iter().map(|(kind, count)| (*kind, *count))
    }

    /// How many of one kind.
    pub fn count(&self, kind: WarningKind) -> u64 {
        self.counts.get(&kind).copied().unwrap_or_default()
    }

    /// How many in all.
    pub fn total(&self) -> u64 {
        self.counts.values().sum()
    }

    /// The warnings whose detail was kept, in the order they came.
    pub fn kept(&self) -> &[Warning] {
        &self.kept
    }
}

impl WarningKind {
    /// Whether it says nothing about cameras.
    pub const fn is_about_pictures(self) -> bool {
        matches!(
            self,
            Self::MissingPicture
                | Self::PictureElsewhere
                | Self::UnexpectedSize
                | Self::TurnedPicture
                | Self::AmbiguousNumbering
                | Self::UnreadablePicture
        )
    }
}

impl fmt::Display for Warning {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}: {}", self.scene, self.detail)
    }
}

impl fmt::Display for WarningKind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.serialize(f)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn whoever_uses_cameras_alone_hears_of_cameras() {
        let mut warnings = Warnings::new();
        for kind in [WarningKind::MissingPicture, WarningKind::BadCamera, WarningKind::TurnedPicture] {
            warnings.push(kind, "s", "detail");
        }
        let left = warnings.about_cameras();
        assert_eq!(left.counts().collect::<Vec<_>>(), [(WarningKind::BadCamera, 1)]);
        assert_eq!(left.kept().len(), 1);
    }
}
