use std::fmt;

use atsplat_files::Sha256Digest;
use serde::{Deserialize, Serialize};

use crate::extrapolation::Margin;
use crate::{EvaluationIndex, IndexEntry, IndexFile, KnownIndex};

/// Which evaluation indices a protocol runs on.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub struct IndexRule {
    /// Scenes with at least one entry in the default index.
    pub scenes: u64,
    /// Number of context views of every entry.
    pub context_views: usize,
    /// Fewest and most targets of an entry in the default index, or in the index derived from it.
    pub targets: (usize, usize),
    /// Published files that the protocol runs on; the first is the default. There may be none if there is a [`Self::sampler`].
    #[serde(default)]
    pub accepted: Vec<AcceptedIndex>,
    /// How the index is derived from the published file, if the protocol has no file of its own.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub derivation: Option<Derivation>,
    /// The sampling rule of `eval/samplers/` that selects frames as this protocol does, for scenes without a published index.
    /// Such numbers are not comparable with published ones.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub sampler: Option<String>,
}

/// A published index file that a protocol accepts.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub struct AcceptedIndex {
    /// Its name among [`crate::KNOWN_INDICES`].
    pub name: String,
    /// Hash of its bytes.
    pub sha256: Sha256Digest,
    /// Why it is accepted, and what to report with it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub note: Option<String>,
}

/// How an index is derived from a published one.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(tag = "rule", rename_all = "kebab-case", deny_unknown_fields)]
pub enum Derivation {
    /// Targets are the `margin` frames before and the `margin` frames after the window; windows that start
    /// too early are shifted (ATSplat's "10 frames before and after the input window").
    ShiftedWindow {
        /// Frames on either side.
        margin: Margin,
    },
}

/// Content hashes of the splits that `protocol extrapolate` makes of published files: the file, the margin, the hash.
///
/// They do not depend on the lengths of scenes, because every scene is long enough: no target is beyond the targets of
/// `depthsplat-dl3dv-12v` in the same scene.
const SPLITS: &[(&str, Margin, Sha256Digest)] = &[(
    "depthsplat-dl3dv-6v",
    Margin::TEN,
    Sha256Digest::literal("4fdda257b6c4b08d51f9334efbd7558918026b89d9bcc1bbda0080b695514bee"),
)];

/// How an index file relates to the files that a protocol accepts.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(tag = "match", rename_all = "kebab-case")]
pub enum IndexMatch<'a> {
    /// The default file, or one of the same content.
    Default {
        /// Name of the file.
        #[serde(rename = "index")]
        name: &'a str,
    },
    /// Another accepted file, which some papers use under this protocol; report its name with the number.
    Alternative {
        /// Name of the file.
        #[serde(rename = "index")]
        name: &'a str,
        /// What the preset says about it.
        note: Option<&'a str>,
    },
    /// What `protocol extrapolate` makes of the default file by the preset's derivation.
    Derived {
        /// Name of the file that it was derived from.
        #[serde(rename = "index")]
        name: &'a str,
    },
    /// The preset's derivation applied to other scenes or other context frames than the default file's, or to only
    /// some of them; or its windows are not known to be where `protocol extrapolate` places them.
    DerivedFromOther {
        /// Name of the file that the protocol's own split is derived from.
        #[serde(rename = "index")]
        name: &'a str,
    },
    /// The published file itself, from which the protocol's split still has to be derived.
    Underived {
        /// Name of the file.
        #[serde(rename = "index")]
        name: &'a str,
    },
    /// Not a published file: numbers are only comparable with numbers on the same index.
    Unpublished,
}

impl fmt::Display for IndexMatch<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Default { name } => write!(f, "its index, {name}"),
            Self::Alternative { name, note: None } => write!(f, "an alternative index, {name}"),
            Self::Alternative { name, note: Some(note) } => write!(f, "an alternative index, {name}: {note}"),
            Self::Derived { name } => write!(f, "its index, derived from {name}"),
            Self::DerivedFromOther { name } => write!(
                f,
                "derived by its rule, but not from all scenes and context frames of {name}, or its windows are not \
                 known to be where `protocol extrapolate` places them: results are comparable only on this file"
            ),
            Self::Underived { name } => {
                write!(f, "{name}, from which `protocol extrapolate` derives its index")
            }
            Self::Unpublished => f.write_str("not one of its indices: results are comparable only on this file"),
        }
    }
}

impl IndexRule {
    /// The accepted index of this name, if it is another one than the protocol's default.
    pub fn alternative(&self, name: &str) -> Option<&AcceptedIndex> {
        self.accepted.iter().skip(1).find(|accepted| accepted.name == name)
    }

    /// Fewest and most targets of an entry: of the default index or the one derived from it, and of the other published files.
    pub(crate) fn target_counts(&self) -> Vec<(usize, usize)> {
        let others = self.accepted.iter().skip(1).filter(|_| self.derivation.is_none());
        let known = others.filter_map(|accepted| KnownIndex::by_name(&accepted.name));
        std::iter::once(self.targets).chain(known.map(|known| known.targets)).collect()
    }

    /// Whether `file` is one of the accepted files, by its bytes or else by its content; or derived from one, by the
    /// targets around its context frames.
    pub fn recognise(&self, file: &IndexFile) -> IndexMatch<'_> {
        self.recognise_hashes(&file.sha256, &file.index)
    }

    fn recognise_hashes(&self, sha256: &Sha256Digest, index: &EvaluationIndex) -> IndexMatch<'_> {
        let by_bytes = self.accepted.iter().position(|accepted| accepted.sha256 == *sha256);
        let by_content = || {
            let content = index.content_hash();
            let known = KnownIndex::by_content(&content).map(|known| known.sha256);
            let embedded = |name: &str| Some(IndexFile::embedded(name)?.ok()?.index.content_hash());
            let is_this =
                |accepted: &AcceptedIndex| known == Some(accepted.sha256) || embedded(&accepted.name) == Some(content);
            self.accepted.iter().position(is_this)
        };
        let position = by_bytes.or_else(by_content);
        match position.and_then(|at| self.accepted.get(at).map(|accepted| (at, accepted))) {
            None => self.recognise_derived(index, SPLITS).unwrap_or(IndexMatch::Unpublished),
            Some((_, accepted)) if self.derivation.is_some() => IndexMatch::Underived { name: &accepted.name },
            Some((0, accepted)) => IndexMatch::Default { name: &accepted.name },
            Some((_, accepted)) => IndexMatch::Alternative { name: &accepted.name, note: accepted.note.as_deref() },
        }
    }

    fn recognise_derived(
        &self,
        index: &EvaluationIndex,
        splits: &[(&str, Margin, Sha256Digest)],
    ) -> Option<IndexMatch<'_>> {
        let (derivation, base) = (self.derivation?, self.accepted.first()?);
        let entries = || index.entries().map(|(_, _, entry)| entry);
        let derived = |entry: &IndexEntry| entry.context.len() == self.context_views && derivation.matches(entry);
        if entries().next().is_none() || !entries().all(derived) {
            return None;
        }
        let name = &base.name;
        // A measured overlap does not change the trials.
        let mut bare = index.clone();
        for entry in bare.scenes.values_mut().flatten() {
            entry.overlap = None;
        }
        let Derivation::ShiftedWindow { margin } = derivation;
        let split = (name.as_str(), margin, bare.content_hash());
        Some(if splits.contains(&split) { IndexMatch::Derived { name } } else { IndexMatch::DerivedFromOther { name } })
    }
}

impl Derivation {
    /// Whether the targets of `entry` are the ones that this rule derives from its context.
    pub fn matches(&self, entry: &IndexEntry) -> bool {
        let Self::ShiftedWindow { margin } = self;
        let Some((first, last)) = entry.window() else { return false };
        let Some(before) = first.checked_sub(margin.get()) else { return false };
        let mut target = entry.target.clone();
        target.sort_unstable();
        target.into_iter().eq((before..first).chain(last.saturating_add(1)..=last.saturating_add(margin.get())))
    }
}

#[cfg(test)]
mod tests {
    use indexmap::IndexMap;

    use super::*;
    use crate::Preset;
    use crate::extrapolation::Extrapolation;

    #[test]
    fn recognises_default_alternative_and_unpublished_files() {
        let preset = Preset::named("dl3dv-12v-512x960").unwrap();
        let accepted = &preset.index.accepted;
        let index = EvaluationIndex::default();
        let matched = |sha256| preset.index.recognise_hashes(&sha256, &index);
        assert_eq!(matched(accepted[0].sha256), IndexMatch::Default { name: "depthsplat-dl3dv-12v" });
        assert!(matches!(matched(accepted[1].sha256), IndexMatch::Alternative { name: "yonosplat-dl3dv-12v", .. }));
        assert_eq!(matched(Sha256Digest::of(b"")), IndexMatch::Unpublished);
    }

    /// The hash is that of a preset that says `accepted = []`.
    #[test]
    fn a_preset_needs_an_accepted_file_or_a_sampling_rule() {
        let text = Preset::text_of("photos-3v-256").unwrap();
        let without = text.replacen("accepted = []\n", "", 1);
        assert_ne!(without, text);
        let preset = Preset::from_toml(&without).unwrap();
        assert_eq!(preset.hash().unwrap(), Preset::named("photos-3v-256").unwrap().hash().unwrap());
        let neither = without.replacen("sampler = \"photos-3v\"\n", "", 1);
        let error = Preset::from_toml(&neither).unwrap_err().to_string();
        assert!(
            error.contains("index.accepted: expected at least one index, or a sampling rule, found none"),
            "{error}"
        );
    }

    #[test]
    fn recognises_derived_indices() {
        let preset = Preset::named("dl3dv-6v-extrapolation").unwrap();
        let recognised =
            |json: &str| preset.index.recognise_derived(&EvaluationIndex::from_json(json.as_bytes()).unwrap(), SPLITS);
        let entry = |context: &str, target: std::ops::RangeInclusive<usize>| {
            let targets: Vec<usize> = (0..10).chain(target).collect();
            format!(r#"{{"s": {{"context": {context}, "target": {targets:?}}}, "short": null}}"#)
        };
        let name = "depthsplat-dl3dv-6v";
        let six = "[10, 20, 30, 40, 50, 59]";
        assert_eq!(recognised(&entry(six, 60..=69)), Some(IndexMatch::DerivedFromOther { name }));
        assert_eq!(recognised(&entry(six, 60..=68)), None, "a target is missing");
        assert_eq!(recognised(&entry(six, 61..=70)), None, "a gap before the targets");
        assert_eq!(recognised(&entry("[10, 20, 30, 40, 59]", 60..=69)), None, "five views");
        assert_eq!(recognised("{}"), None);
    }

    /// Windows that were all shifted equally have the same gaps and the same targets around them.
    #[test]
    fn only_the_toolkits_own_split_is_the_derived_index() {
        let preset = Preset::named("dl3dv-6v-extrapolation").unwrap();
        let published = br#"{"zero": {"context": [0, 10, 20, 30, 40, 49], "target": [5]},
                             "later": {"context": [12, 20, 28, 36, 44, 50], "target": [15]}}"#;
        let published = EvaluationIndex::from_json(published).unwrap();
        let split = Extrapolation::from(preset.index.derivation.unwrap()).split(&published, &IndexMap::new()).index;
        let name = "depthsplat-dl3dv-6v";
        let splits = [(name, Margin::TEN, split.content_hash())];
        let recognised = |index: &EvaluationIndex| preset.index.recognise_derived(index, &splits).unwrap();
        assert_eq!(recognised(&split), IndexMatch::Derived { name });
        let mut measured = split.clone();
        measured.scenes["zero"][0].overlap = Some(0.5.into());
        assert_eq!(recognised(&measured), IndexMatch::Derived { name }, "an overlap does not change the trial");
        let mut moved = split.clone();
        for entry in moved.scenes.values_mut().flatten() {
            for frame in entry.context.iter_mut().chain(&mut entry.target) {
                *frame += 5;
            }
        }
        let found = recognised(&moved);
        assert_eq!(found, IndexMatch::DerivedFromOther { name });
        assert!(found.to_string().contains("where `protocol extrapolate` places them"), "{found}");
    }

    #[test]
    fn every_accepted_file_of_a_derivation_is_underived() {
        let mut rule = Preset::named("dl3dv-6v-extrapolation").unwrap().index;
        let other = Sha256Digest::of(b"another file");
        rule.accepted.push(AcceptedIndex { name: "mine".to_owned(), sha256: other, note: None });
        let index = EvaluationIndex::default();
        assert_eq!(rule.recognise_hashes(&other, &index), IndexMatch::Underived { name: "mine" });
    }
}
