use std::path::Path;

use atsplat_files::{FileError, Malformed, Sha256Digest};
use atsplat_numeric::counted;
use atsplat_scene::{WarningKind, Warnings};

use super::read::{self, IndexNotices, Parsed};
use super::{EvaluationIndex, IndexLayout};
use crate::{KnownIndex, ProtocolError};

/// An index file: its content, and what identifies it.
#[derive(Clone, Debug, PartialEq)]
pub struct IndexFile {
    /// The file's content.
    pub index: EvaluationIndex,
    /// How the file is formatted.
    pub layout: IndexLayout,
    /// Hash of the file's bytes, which identifies official files.
    pub sha256: Sha256Digest,
    /// Size of the file in bytes.
    pub size: u64,
    /// Irregularities that do not prevent its use.
    pub notices: IndexNotices,
}

impl IndexFile {
    /// Parses the bytes of an index file.
    ///
    /// # Errors
    /// [`ProtocolError::Malformed`] with scene key, field, element, line and column for text that is not JSON,
    /// a frame number that is negative, fractional or above [`super::IndexEntry::MAX_FRAME`], an overlap
    /// outside [0, 1] other than -1, a scored frame that is no target, and a missing or repeated field.
    pub fn parse(bytes: &[u8]) -> Result<Self, ProtocolError> {
        let Parsed { index, layout, notices } = read::parse(bytes)?;
        Ok(Self { index, layout, sha256: Sha256Digest::of(bytes), size: bytes.len() as u64, notices })
    }

    /// Reads an index file.
    ///
    /// # Errors
    /// [`ProtocolError::Io`], or [`ProtocolError::InFile`] around the errors of [`Self::parse`].
    pub fn read(path: &Path) -> Result<Self, ProtocolError> {
        let bytes = atsplat_files::read(path)
            .map_err(FileError::during::<ProtocolError>("reading an evaluation index", path))?;
        let file = Self::parse(&bytes).map_err(|error| error.in_file(path))?;
        let known = file.recognised().map_or("no published index", |known| known.path);
        tracing::info!(file = %path.display(), scenes = file.index.scenes.len(), known, "read evaluation index");
        Ok(file)
    }

    /// The official file with the same bytes, or else the one with the same content.
    pub fn recognised(&self) -> Option<&'static KnownIndex> {
        KnownIndex::by_sha256(&self.sha256).or_else(|| KnownIndex::by_content(&self.index.content_hash()))
    }

    /// Warns of fields, and of targets that are not scored, that are lost when a command writes a new index from this one.
    pub fn warn_of_unknown_fields(&self, path: &Path, warnings: &mut Warnings) {
        for (name, count) in &self.notices.unknown_fields {
            let detail = format!("{count} × field {name:?}, which the format does not define: not written");
            warnings.push(WarningKind::UnknownIndexField, path.display().to_string(), detail);
        }
        if self.notices.unscored_targets > 0 {
            let lost = counted(self.notices.unscored_targets, "target");
            let detail =
                format!("{lost} outside the field \"target_quantify\", which lists those to score: not written");
            warnings.push(WarningKind::UnknownIndexField, path.display().to_string(), detail);
        }
    }

    /// The index, unless the file lists a scene twice.
    ///
    /// # Errors
    /// [`ProtocolError::Malformed`] for a scene key that occurs twice.
    pub fn into_unambiguous(self) -> Result<EvaluationIndex, ProtocolError> {
        match self.notices.duplicate_keys.first() {
            None => Ok(self.index),
            Some(key) => {
                let location = format!("scene {key:?}");
                Err(Malformed::new("evaluation index", location, "every scene key once", "it again").into())
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::*;

    #[test]
    fn a_file_has_index_layout_and_hash_of_what_was_written() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("index.json");
        let index = EvaluationIndex::from_json(br#"{"a": {"context": [1, 2], "target": [1]}, "b": null}"#).unwrap();
        let text = index.to_json(&IndexLayout::NOPOSPLAT);
        fs::write(&path, &text).unwrap();
        let file = IndexFile::read(&path).unwrap();
        assert_eq!((file.sha256, file.layout), (Sha256Digest::of(text.as_bytes()), IndexLayout::NOPOSPLAT));
        assert_eq!(file.into_unambiguous().unwrap(), index);
    }

    #[test]
    fn what_is_not_written_is_a_warning() {
        let json = br#"{"a": {"context": [0, 9], "target": [0, 3, 5, 9], "target_quantify": [3, 5], "note": 1}}"#;
        let mut warnings = Warnings::new();
        IndexFile::parse(json).unwrap().warn_of_unknown_fields(Path::new("index.json"), &mut warnings);
        let lost: Vec<_> = warnings.kept().iter().map(|warning| (warning.kind, warning.detail.as_str())).collect();
        let expected = [
            "1 × field \"note\", which the format does not define: not written",
            "2 targets outside the field \"target_quantify\", which lists those to score: not written",
        ];
        assert_eq!(lost, expected.map(|detail| (WarningKind::UnknownIndexField, detail)));
    }

    #[test]
    fn errors_end_with_the_path() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("index.json");
        let absent = IndexFile::read(&path).unwrap_err().to_string();
        assert!(absent.starts_with("reading an evaluation index: ") && absent.ends_with("index.json)"), "{absent}");
        fs::write(&path, "{").unwrap();
        let broken = IndexFile::read(&path).unwrap_err().to_string();
        assert!(broken.contains("line 1 column 1") && broken.ends_with("index.json)"), "{broken}");
    }
}
