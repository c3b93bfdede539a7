use std::collections::BTreeMap;
use std::fmt;

use serde::Serialize;

/// A kind of problem with part of a dataset that leaves the rest usable.
///
/// The order is that of reports; the kebab-case names are stable and used in JSON and the results store. Kinds about one
/// image count images; all others, also those about cameras, count scenes, or the chunks or files that contain them.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize)]
#[cfg_attr(test, derive(serde::Deserialize))]
#[serde(rename_all = "kebab-case")]
#[non_exhaustive]
pub enum WarningKind {
    /// A frame's image file does not exist, or several files may be it.
    MissingImage,
    /// A frame's image file is empty; found by an inspection, which looks at every file.
    EmptyImage,
    /// An image was found with another extension or in another folder than listed.
    #[serde(rename = "image-elsewhere")]
    ImageAtOtherPath,
    /// An image among those of a trajectory that no row names: the row is lost, or the image belongs elsewhere. In an inspection, also
    /// one next to those of a COLMAP model or `transforms.json`.
    UnlistedImage,
    /// Two frames of a scene have the same image.
    DuplicateImage,
    /// Frames have a pose that is not finite or no rotation, or a camera whose centre overflows. Unusable intrinsics make their scene
    /// [`Self::UnreadableScene`].
    BadCamera,
    /// A camera is implausibly far from the origin.
    DistantCamera,
    /// A camera is far outside the others of its scene, as those that structure from motion failed to place.
    #[serde(rename = "outlying-camera")]
    OutlierCamera,
    /// All frames of a scene have the same pose; in an inspection, also frames with exactly an earlier frame's pose, as in the still
    /// stretches of videos, and cameras that are all in one place.
    RepeatedPose,
    /// The determinant of the rotation matrix deviates from 1 by more than `numpy.allclose` allows, an entry of `R Rᵀ` from
    /// that of the identity by more than 1e-5, or the length of a quaternion from 1 by more than 1e-3.
    ImperfectRotation,
    /// Two frames have the same timestamp, or two images the same number at the end of their names.
    DuplicateTimestamp,
    /// Timestamps decrease, or the numbers at the end of images' names, as unpadded ones that are sorted as text.
    UnorderedTimestamps,
    /// Intrinsics that seem to be in another unit than their format's or for another size, a principal point more than 0.15 of the size
    /// off the middle, or pixels that are not nearly square.
    ImplausibleIntrinsics,
    /// A field of view that contradicts the focal length in pixels or the other field of view in the file, which is used.
    ContradictoryFieldOfView,
    /// A `transforms.json` states a focal length in pixels and no principal point: the centre is used, as by instant-ngp; nerfstudio
    /// requires `cx` and `cy`.
    AssumedPrincipalPoint,
    /// A field of a `transforms.json` or a camera path about frames, images or intrinsics that is not read, such as `mask_path`;
    /// or a mask next to an image, or in a folder `masks` next to a COLMAP model's images.
    UnreadField,
    /// Field of view above 100°, which pixelSplat's loader silently drops.
    WideFieldOfView,
    /// The principal point is off the centre by more than 1e-3 and at most 0.15, which renderers with a symmetric frustum ignore.
    OffCentrePrincipalPoint,
    /// The lens has distortion: protocols render through it, unless they ignore it.
    LensDistortion,
    /// The lens model ends inside the image: no ray belongs to the pixels beyond.
    LensEndsInside,
    /// An image's size differs from the one in the metadata or the protocol, or its pixels are not square.
    UnexpectedSize,
    /// The images of a scene have several sizes, as those of several cameras; found by an inspection, among the headers that it reads.
    MixedSizes,
    /// An image's EXIF orientation is not upright; it is ignored, as in all loaders of the field.
    TurnedImage,
    /// An image has an alpha channel, which is dropped without compositing, as in all loaders of the field.
    DroppedAlpha,
    /// An image has 16-bit samples, of which only the high byte is kept, as in all loaders of the field.
    DroppedLowBytes,
    /// A PNG states another encoding of its samples than that for a display, such as linear light, high dynamic range or a narrow range
    /// (`gAMA`, `cICP`); they are used as they are, as in all loaders of the field.
    OtherEncoding,
    /// A scene of a dataset is stored twice, in two formats or two chunks, or listed twice in one; the first is used, or the one that
    /// the index lists.
    DuplicateScene,
    /// A scene could not be read, or is another one of its chunk with the key of an earlier one.
    UnreadableScene,
    /// The index lists a scene that the dataset does not contain.
    SceneNotFound,
    /// A field that the format of an index does not define: it is not in what is written.
    UnknownIndexField,
    /// Next to the scenes: a scene in another format or with the name of one in another folder, a trajectory whose name begins with a
    /// dot, images without cameras, or a further model of one capture. It is not read.
    IgnoredScene,
    /// Two images have the same number, or the same name except for its extension, by which they were not looked up; one is used.
    AmbiguousNumbering,
    /// A chunk next to an index that lists none of its scenes.
    UnindexedChunk,
    /// A scene that the index does not list, or that has no key or that of an earlier one, in a chunk of which it lists others.
    UnindexedScene,
    /// A scene that the chunks have, but that their index does not list. It is read, as in the published loaders.
    SceneBeyondIndex,
    /// An image cannot be read: its header or, where it is decoded, its content; or it is cut short.
    UnreadableImage,
    /// A folder or file that a search for datasets and evaluation indices left out.
    NotSearched,
}

/// One warning about a scene or file.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Warning {
    /// The kind of problem.
    pub kind: WarningKind,
    /// Scene key, or the file if the scene is not known.
    pub scene: String,
    /// Details: line, field, expected, found.
    pub detail: String,
}

/// Collects warnings: passed down as a parameter, counted by kind, printed and stored at the end.
///
/// All warnings are counted, but only the first [`Warnings::KEPT_PER_KIND`] of each kind are kept, so that the report of
/// a large dataset with many problems stays readable.
#[derive(Clone, Debug, Default)]
pub struct Warnings {
    counts: BTreeMap<WarningKind, u64>,
    kept: Vec<Warning>,
}

impl Warnings {
    /// Maximum number of warnings kept of each kind.
    pub const KEPT_PER_KIND: u64 = 20;

    /// An empty collection.
    pub fn new() -> Self {
        Self::default()
    }

    /// Adds a warning.
    pub fn push(&mut self, kind: WarningKind, scene: impl Into<String>, detail: impl Into<String>) {
        let count = self.counts.entry(kind).or_default();
        *count += 1;
        if *count <= Self::KEPT_PER_KIND {
            self.kept.push(Warning { kind, scene: scene.into(), detail: detail.into() });
        }
    }

    /// Adds another collection's warnings, as if they had been pushed here.
    pub fn merge(&mut self, other: Self) {
        for (kind, count) in other.counts {
            *self.counts.entry(kind).or_default() += count;
        }
        for warning in other.kept {
            let kept = self.kept.iter().filter(|w| w.kind == warning.kind).count() as u64;
            if kept < Self::KEPT_PER_KIND {
                self.kept.push(warning);
            }
        }
    }

    /// Joins the warnings of another reading of the same data: of each kind, those of the reading with more of them. Each
    /// counts once, although both readings found it.
    pub fn join(&mut self, other: &Self) {
        for (kind, count) in other.counts() {
            if count > self.count(kind) {
                self.counts.insert(kind, count);
                self.kept.retain(|warning| warning.kind != kind);
                self.kept.extend(other.kept.iter().filter(|warning| warning.kind == kind).cloned());
            }
        }
    }

    /// The warnings with those of one kind as another.
    #[must_use]
    pub(crate) fn with_kind_as(self, kind: WarningKind, other: WarningKind) -> Self {
        let renamed = |found: WarningKind| if found == kind { other } else { found };
        let mut all = Self::new();
        for (found, count) in self.counts {
            *all.counts.entry(renamed(found)).or_default() += count;
        }
        all.kept = self.kept.into_iter().map(|warning| Warning { kind: renamed(warning.kind), ..warning }).collect();
        all
    }

    /// The warnings without those about images.
    #[must_use]
    pub fn about_cameras(mut self) -> Self {
        self.counts.retain(|kind, _| !kind.is_about_images());
        self.kept.retain(|warning| !warning.kind.is_about_images());
        self
    }

    /// Removes the warnings of a kind about scenes that turned out to be no problem. Where there are more than are kept, all stay:
    /// which scenes the others are about is not known.
    pub fn remove(&mut self, kind: WarningKind, is_no_problem: impl Fn(&str) -> bool) {
        if self.count(kind) > Self::KEPT_PER_KIND {
            return;
        }
        self.kept.retain(|warning| warning.kind != kind || !is_no_problem(&warning.scene));
        let left = self.kept.iter().filter(|warning| warning.kind == kind).count() as u64;
        if left > 0 {
            self.counts.insert(kind, left);
        } else {
            self.counts.remove(&kind);
        }
    }

    /// Counts by kind, in the order of the kinds.
    pub fn counts(&self) -> impl Iterator<Item = (WarningKind, u64)> {
        self.counts.iter().map(|(kind, count)| (*kind, *count))
    }

    /// Each kind with its count and its first warning, in the order of the kinds.
    #[expect(clippy::expect_used, reason = "the first warning of each kind is kept")]
    pub fn summary(&self) -> impl Iterator<Item = (WarningKind, u64, &Warning)> {
        self.counts().map(|(kind, count)| {
            let first = self.kept.iter().find(|warning| warning.kind == kind);
            (kind, count, first.expect("the first of each kind is kept"))
        })
    }

    /// Number of warnings of one kind.
    pub fn count(&self, kind: WarningKind) -> u64 {
        self.counts.get(&kind).copied().unwrap_or_default()
    }

    /// Number of all warnings.
    pub fn total(&self) -> u64 {
        self.counts.values().sum()
    }

    /// The kept warnings, in order of arrival.
    pub fn kept(&self) -> &[Warning] {
        &self.kept
    }
}

impl WarningKind {
    /// Whether the problem concerns images and not cameras.
    pub const fn is_about_images(self) -> bool {
        matches!(
            self,
            Self::MissingImage
                | Self::EmptyImage
                | Self::ImageAtOtherPath
                | Self::UnlistedImage
                | Self::DuplicateImage
                | Self::UnexpectedSize
                | Self::MixedSizes
                | Self::TurnedImage
                | Self::DroppedAlpha
                | Self::DroppedLowBytes
                | Self::OtherEncoding
                | Self::AmbiguousNumbering
                | Self::UnreadableImage
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

    /// The page lists each kind once, in the order of reports. The error about a kind that there is not names all that there are.
    #[test]
    fn documented() {
        let page = include_str!("../../../docs/warnings.md");
        let listed = page.lines().skip_while(|line| *line != "| kind | what was found |").skip(2);
        let listed: Vec<&str> = listed.map_while(|line| line.strip_prefix("| `")?.split('`').next()).collect();
        let error = serde_json::from_str::<WarningKind>("\"none\"").unwrap_err().to_string();
        let kinds: Vec<&str> = error.split('`').skip(3).step_by(2).collect();
        assert!(kinds.len() > 2 && kinds.contains(&"image-elsewhere"), "{error}");
        assert_eq!(listed, kinds);
    }

    #[test]
    fn joined_readings_count_each_warning_once() {
        let reading = |frames: &[u32], cameras: &[&str]| {
            let mut warnings = Warnings::new();
            for frame in frames {
                warnings.push(WarningKind::MissingImage, "s", format!("frame {frame}"));
            }
            for detail in cameras {
                warnings.push(WarningKind::BadCamera, "s", *detail);
            }
            warnings
        };
        let many: Vec<u32> = (0..30).collect();
        let mut all = reading(&many, &["x"]);
        all.join(&reading(&many, &["y", "z"]));
        all.join(&reading(&[7], &[]));
        assert_eq!(all.counts().collect::<Vec<_>>(), [(WarningKind::MissingImage, 30), (WarningKind::BadCamera, 2)]);
        let details: Vec<&str> = all.kept().iter().skip(20).map(|warning| warning.detail.as_str()).collect();
        assert_eq!(details, ["y", "z"], "after the twenty images that are kept");
    }

    #[test]
    fn warnings_are_removed_only_if_all_of_their_kind_are_known() {
        let ignored = |scenes: usize| {
            let mut warnings = Warnings::new();
            for scene in 0..scenes {
                warnings.push(WarningKind::IgnoredScene, scene.to_string(), "detail");
                warnings.push(WarningKind::BadCamera, scene.to_string(), "detail");
            }
            warnings
        };
        let summary = |warnings: &Warnings| -> Vec<(WarningKind, u64, String)> {
            warnings.summary().map(|(kind, count, first)| (kind, count, first.scene.clone())).collect()
        };
        let mut few = ignored(20);
        few.remove(WarningKind::IgnoredScene, |scene| scene != "7");
        let expected = [(WarningKind::BadCamera, 20, "0".to_owned()), (WarningKind::IgnoredScene, 1, "7".to_owned())];
        assert_eq!(summary(&few), expected);
        few.remove(WarningKind::IgnoredScene, |scene| scene == "7");
        assert_eq!(summary(&few), expected[..1]);
        let mut many = ignored(21);
        many.remove(WarningKind::IgnoredScene, |_| true);
        assert_eq!(summary(&many), summary(&ignored(21)));
    }

    #[test]
    fn about_cameras_omits_warnings_about_images() {
        let mut warnings = Warnings::new();
        let about_images = [WarningKind::MissingImage, WarningKind::TurnedImage, WarningKind::DroppedLowBytes];
        for kind in about_images.into_iter().chain([WarningKind::BadCamera]) {
            warnings.push(kind, "s", "detail");
        }
        let left = warnings.about_cameras();
        assert_eq!(left.counts().collect::<Vec<_>>(), [(WarningKind::BadCamera, 1)]);
        assert_eq!(left.kept().len(), 1);
    }
}
