use serde::{Deserialize, Serialize};

use crate::{EvaluationIndex, IndexFile, Sha256Digest};

/// Which evaluation index a protocol is about.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub struct IndexRule {
    /// Scenes with at least one entry in the default index.
    pub scenes: u64,
    /// Context views of every entry.
    pub context_views: usize,
    /// Fewest and most targets of an entry in the default index, before any derivation.
    pub targets: (usize, usize),
    /// Published files that the protocol runs on; the first is the default.
    pub accepted: Vec<AcceptedIndex>,
    /// What is made of the published file, where the protocol has no file of its own.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub derivation: Option<Derivation>,
}

/// A published index file that a protocol accepts.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub struct AcceptedIndex {
    /// Its name among [`crate::KNOWN_INDICES`].
    pub name: String,
    /// Hash of its bytes.
    pub sha256: Sha256Digest,
    /// Why it is an alternative, and what to report with it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub note: Option<String>,
}

/// How an index is made from a published one.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(tag = "rule", rename_all = "kebab-case", deny_unknown_fields)]
pub enum Derivation {
    /// Targets are the `margin` frames before and the `margin` frames after the window; windows that start
    /// too early are shifted (ATSplat's "10 frames before and after the input window").
    ShiftedWindow {
        /// Frames on either side.
        margin: usize,
    },
}

/// How an index file relates to those that a protocol accepts.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(tag = "match", rename_all = "kebab-case")]
pub enum IndexMatch<'a> {
    /// The default file, or one of the same content.
    Default {
        /// Name of the file.
        name: &'a str,
    },
    /// A file that some use under this protocol; its name belongs beside the number.
    Alternative {
        /// Name of the file.
        name: &'a str,
        /// What the preset says about it.
        note: Option<&'a str>,
    },
    /// No published file: numbers compare only with numbers on the same index.
    Unpublished,
}

impl IndexRule {
    /// Whether `file` is one of the accepted ones, by its bytes or else by its content.
    pub fn recognise(&self, file: &IndexFile) -> IndexMatch<'_> {
        self.recognise_hashes(&file.sha256, &file.index)
    }

    fn recognise_hashes(&self, sha256: &Sha256Digest, index: &EvaluationIndex) -> IndexMatch<'_> {
        let by_bytes = self.accepted.iter().position(|accepted| accepted.sha256 == *sha256);
        let by_content = || {
            let known = crate::KnownIndex::by_content(&index.content_hash())?;
            self.accepted.iter().position(|accepted| accepted.sha256 == known.sha256)
        };
        let position = by_bytes.or_else(by_content);
        match position.and_then(|at| self.accepted.get(at).map(|accepted| (at, accepted))) {
            None => IndexMatch::Unpublished,
            Some((0, accepted)) => IndexMatch::Default { name: &accepted.name },
            Some((_, accepted)) => IndexMatch::Alternative { name: &accepted.name, note: accepted.note.as_deref() },
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Preset;

    #[test]
    fn default_alternative_and_unpublished_files() {
        let preset = Preset::named("dl3dv-12v-512x960").unwrap();
        let accepted = &preset.index.accepted;
        let index = EvaluationIndex::default();
        let matched = |sha256| preset.index.recognise_hashes(&sha256, &index);
        assert_eq!(matched(accepted[0].sha256), IndexMatch::Default { name: "depthsplat-dl3dv-12v" });
        assert!(matches!(matched(accepted[1].sha256), IndexMatch::Alternative { name: "yonosplat-dl3dv-12v", .. }));
        assert_eq!(matched(Sha256Digest::of(b"")), IndexMatch::Unpublished);
    }
}
