use std::fmt;

use serde::de::value::{Error, StrDeserializer};
use serde::{Deserialize, Serialize};

/// A kind of warning in a store that its readers distinguish from others.
///
/// [`crate::WarningCount::kind`] is its text, or its text with what it is about, a method or a reason: [`Self::about`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
pub enum RunWarning {
    /// A method that names another, whose settings the preset does not state.
    #[serde(rename = "methods with the preset's own poses and planes, because it states none of the method they name")]
    UnlistedSettings,
    /// A method for which nobody chose a setting, although the preset lists one for its name.
    #[serde(
        rename = "methods with the preset's own poses and planes, although it states others for a method of their name"
    )]
    SettingsNotChosen,
    /// Learned metrics with other weights than the published ones, whose numbers are of another metric.
    #[serde(rename = "learned metrics with other weights than the published ones")]
    UnpublishedWeights,
    /// A method's imported files that are scored under several protocols, although these give it other context views.
    #[serde(rename = "scenes whose files serve protocols with other context views")]
    SharedFiles,
    /// A method's results that a run evaluated again, for a metric or an image that they lack, and that failed then. The run after
    /// it tries again.
    #[serde(rename = "results that failed when they were evaluated again, so that the earlier ones stay")]
    FailedAgain,
    /// Stores merged into one that name other data than the first.
    #[serde(rename = "runs on data in another place than the first")]
    OtherData,
    /// Merged stores whose imported files of a method are in another folder than the first's.
    #[serde(rename = "runs on files in another folder than the first")]
    OtherFolder,
    /// Scenes of an index that the data lack.
    #[serde(rename = "scenes of the index that are not in the data")]
    MissingScenes,
    /// Entries of a published index that the split derived from it drops, for a reason.
    #[serde(rename = "entries of the published index that have no place in its split")]
    DroppedBySplit,
    /// Frames without an image, which a sampled index leaves out.
    #[serde(rename = "frames without an image, which are not sampled")]
    WithoutImage,
    /// Images that cannot be read, which a sampled index leaves out.
    #[serde(rename = "images that cannot be read, found in sampling")]
    UnreadableImage,
    /// Scenes that are not read, for a reason, which a sampled index leaves out.
    #[serde(rename = "scenes that are not read, and not sampled")]
    NotRead,
    /// Scenes that have no entry in a sampled index.
    #[serde(rename = "scenes without an entry in the sampled index")]
    WithoutEntry,
}

impl RunWarning {
    /// The kind of warnings about one method or reason.
    pub fn about(self, subject: &str) -> String {
        format!("{self}: {subject}")
    }

    /// The kind that a warning states, and what it is about; `None` for other kinds.
    pub fn of(kind: &str) -> Option<(Self, Option<&str>)> {
        let (text, subject) = kind.split_once(": ").map_or((kind, None), |(text, subject)| (text, Some(subject)));
        Some((Self::deserialize(StrDeserializer::<Error>::new(text)).ok()?, subject))
    }

    /// Whether a warning is of this kind, whatever it is about.
    pub fn is_of(self, kind: &str) -> bool {
        Self::of(kind).is_some_and(|(known, _)| known == self)
    }

    /// The method that a warning is about, if it is about one.
    pub fn method_of(kind: &str) -> Option<&str> {
        let (known, subject) = Self::of(kind)?;
        match known {
            Self::UnlistedSettings
            | Self::SettingsNotChosen
            | Self::SharedFiles
            | Self::FailedAgain
            | Self::OtherFolder => subject,
            Self::UnpublishedWeights
            | Self::OtherData
            | Self::MissingScenes
            | Self::DroppedBySplit
            | Self::WithoutImage
            | Self::UnreadableImage
            | Self::NotRead
            | Self::WithoutEntry => None,
        }
    }

    /// Whether it is about a whole run, so that every shard of it counts the same.
    pub(crate) const fn is_of_run(self) -> bool {
        match self {
            Self::UnlistedSettings | Self::SettingsNotChosen | Self::UnpublishedWeights => true,
            Self::SharedFiles
            | Self::FailedAgain
            | Self::OtherData
            | Self::OtherFolder
            | Self::MissingScenes
            | Self::DroppedBySplit
            | Self::WithoutImage
            | Self::UnreadableImage
            | Self::NotRead
            | Self::WithoutEntry => false,
        }
    }
}

impl fmt::Display for RunWarning {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.serialize(f)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn kinds_are_read_from_the_texts_of_stores() {
        for (text, expected) in [
            ("scenes of the index that are not in the data", Some((RunWarning::MissingScenes, None))),
            (
                "scenes that are not read, and not sampled: ignored-scene",
                Some((RunWarning::NotRead, Some("ignored-scene"))),
            ),
            ("scenes that are not read, and not sampled, but", None),
            ("missing-image", None),
        ] {
            assert_eq!(RunWarning::of(text), expected, "{text}");
        }
        let shared = RunWarning::SharedFiles.about("mine: better");
        assert_eq!(shared, "scenes whose files serve protocols with other context views: mine: better");
        assert_eq!(RunWarning::method_of(&shared), Some("mine: better"));
        assert_eq!(RunWarning::method_of(&RunWarning::NotRead.about("mine")), None, "it is about scenes");
        assert_eq!(RunWarning::method_of(&RunWarning::FailedAgain.to_string()), None);
    }

    /// Stores have these texts: by another one, readers would no longer recognise the warnings of older stores.
    #[test]
    fn texts_of_stores_stay() {
        let stored = [
            (
                RunWarning::UnlistedSettings,
                "methods with the preset's own poses and planes, because it states none of the method they name",
            ),
            (
                RunWarning::SettingsNotChosen,
                "methods with the preset's own poses and planes, although it states others for a method of their name",
            ),
            (RunWarning::UnpublishedWeights, "learned metrics with other weights than the published ones"),
            (RunWarning::SharedFiles, "scenes whose files serve protocols with other context views"),
            (
                RunWarning::FailedAgain,
                "results that failed when they were evaluated again, so that the earlier ones stay",
            ),
            (RunWarning::OtherData, "runs on data in another place than the first"),
            (RunWarning::OtherFolder, "runs on files in another folder than the first"),
            (RunWarning::MissingScenes, "scenes of the index that are not in the data"),
            (RunWarning::DroppedBySplit, "entries of the published index that have no place in its split"),
            (RunWarning::WithoutImage, "frames without an image, which are not sampled"),
            (RunWarning::UnreadableImage, "images that cannot be read, found in sampling"),
            (RunWarning::NotRead, "scenes that are not read, and not sampled"),
            (RunWarning::WithoutEntry, "scenes without an entry in the sampled index"),
        ];
        for (warning, text) in stored {
            assert_eq!((warning.to_string().as_str(), RunWarning::of(text)), (text, Some((warning, None))));
            assert!(!text.contains(": "), "what follows the first colon is what a warning is about: {text}");
        }
        let all = RunWarning::deserialize(StrDeserializer::<Error>::new("none")).unwrap_err().to_string();
        let listed = stored.map(|(_, text)| format!("`{text}`")).join(", ");
        assert_eq!(all, format!("unknown variant `none`, expected one of {listed}"), "every kind has its text here");
    }
}
