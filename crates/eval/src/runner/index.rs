use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

use atsplat_files::Sha256Digest;
use atsplat_protocol::extrapolation::{Extrapolation, scene_lengths};
use atsplat_protocol::{EvaluationIndex, IndexBuilder, IndexFile, IndexLayout, IndexMatch, Preset};
use atsplat_scene::{SceneSource, Warnings};

use crate::EvalError;
use crate::rows::SAMPLED_BY;

/// Larger files are not searched: the largest published index has 1.2 MB.
const MAX_BYTES: u64 = 64 << 20;
/// Depth to which folders are searched for indices.
const MAX_DEPTH: usize = 4;

/// An evaluation index and its origin.
#[derive(Clone, Debug, PartialEq)]
pub struct PlannedIndex {
    /// The index.
    pub index: EvaluationIndex,
    /// Its file, or how it was generated.
    pub description: String,
    /// Hash of the file's bytes; for a generated index, of its serialisation.
    pub sha256: Sha256Digest,
    /// The published index that it equals or was derived from.
    pub name: Option<String>,
    /// Unknown fields of the file, and how often each occurs; empty for a published index, whose fields are not
    /// questioned.
    pub unknown_fields: BTreeMap<String, u64>,
}

impl PlannedIndex {
    /// Reads an index file, or finds the preset's index in a folder by its hash. If the preset's split has to be derived from
    /// a published index, the split is computed with the scene lengths of the dataset.
    ///
    /// # Errors
    /// [`EvalError::Protocol`] for a file that is not an index or has conflicting entries for a scene, [`EvalError::Io`],
    /// [`EvalError::Settings`] for a folder without the preset's index.
    pub fn read(
        path: &Path,
        preset: &Preset,
        source: &dyn SceneSource,
        warnings: &mut Warnings,
    ) -> Result<Self, EvalError> {
        let path = if path.is_dir() { published_below(path, preset)? } else { path.to_owned() };
        let file = IndexFile::read(&path)?;
        let sha256 = file.sha256;
        let matched = preset.index.recognise(&file);
        let name = match matched {
            IndexMatch::Default { name }
            | IndexMatch::Alternative { name, .. }
            | IndexMatch::Derived { name }
            | IndexMatch::Underived { name } => Some(name.to_owned()),
            IndexMatch::DerivedFromOther { .. } | IndexMatch::Unpublished => None,
        };
        let unknown_fields = match name {
            Some(_) => BTreeMap::new(),
            None => file.notices.unknown_fields.clone(),
        };
        let underived = matches!(matched, IndexMatch::Underived { .. });
        let index = file.into_unambiguous().map_err(|error| error.in_file(&path))?;
        let description = path.display().to_string();
        match preset.index.derivation.filter(|_| underived) {
            None => Ok(Self { index, description, sha256, name, unknown_fields }),
            Some(derivation) => {
                let keys = source.keys();
                let present = index.scenes.iter().filter(|(key, _)| keys.contains(key));
                let present = EvaluationIndex { scenes: present.map(|(k, e)| (k.clone(), e.clone())).collect() };
                let lengths = scene_lengths(&present, source, &|| (), warnings);
                let split = Extrapolation::from(derivation).split(&index, &lengths);
                Ok(Self::generated(
                    split.index,
                    format!("{description}, its windows with frames before and after them"),
                    name,
                ))
            }
        }
    }

    /// Samples an index, as `protocol build` does, by the rule of this name or path.
    pub fn sampled(name: &str, rule: &IndexBuilder, source: &dyn SceneSource, warnings: &mut Warnings) -> Self {
        let built = rule.build(source, &|| (), warnings);
        let mut description = format!("{SAMPLED_BY}{name}");
        if built.entries == 0 && !built.nulls.is_empty() {
            let reasons: Vec<String> =
                built.nulls.iter().map(|(reason, scenes)| format!("{scenes} {reason}")).collect();
            description = format!("{description}; scenes without an entry: {}", reasons.join(", "));
        }
        Self::generated(built.index, description, None)
    }

    /// The index next to a dataset: `<preset>.json`, `evaluation_index_<dataset>.json` or `evaluation_index.json` in its
    /// folder.
    pub fn next_to(data: &Path, preset: &Preset) -> Option<PathBuf> {
        let names = [
            format!("{}.json", preset.name),
            format!("evaluation_index_{}.json", preset.dataset),
            "evaluation_index.json".to_owned(),
        ];
        let folder = if data.is_dir() { data } else { data.parent()? };
        names.into_iter().map(|name| folder.join(name)).find(|path| path.is_file())
    }

    fn generated(index: EvaluationIndex, description: String, name: Option<String>) -> Self {
        let sha256 = Sha256Digest::of(index.to_json(&IndexLayout::PIXELSPLAT).as_bytes());
        Self { index, description, sha256, name, unknown_fields: BTreeMap::new() }
    }
}

/// The first of a preset's accepted indices in a folder, in any subfolder and under any name.
fn published_below(folder: &Path, preset: &Preset) -> Result<PathBuf, EvalError> {
    let mut found: Vec<(Sha256Digest, PathBuf)> = Vec::new();
    let mut folders = vec![(folder.to_owned(), 0)];
    while let Some((folder, depth)) = folders.pop() {
        let entries = fs::read_dir(&folder).map_err(EvalError::io("searching for evaluation indices", &folder))?;
        for path in entries.flatten().map(|entry| entry.path()) {
            let is_json = path.extension().is_some_and(|extension| extension == "json");
            if path.is_dir() && depth < MAX_DEPTH {
                folders.push((path, depth + 1));
            } else if is_json && fs::metadata(&path).is_ok_and(|data| data.is_file() && data.len() <= MAX_BYTES) {
                let bytes = fs::read(&path).map_err(EvalError::io("searching for evaluation indices", &path))?;
                found.push((Sha256Digest::of(&bytes), path));
            }
        }
    }
    found.sort_by(|(_, a), (_, b)| a.cmp(b));
    let accepted = &preset.index.accepted;
    let by_hash = |sha256: &Sha256Digest| found.iter().find(|(hash, _)| hash == sha256).map(|(_, path)| path.clone());
    accepted.iter().find_map(|accepted| by_hash(&accepted.sha256)).ok_or_else(|| {
        let names: Vec<&str> = accepted.iter().map(|accepted| accepted.name.as_str()).collect();
        EvalError::Settings {
            what: "evaluation index",
            expected: format!("the file of {} for the preset {}", names.join(" or "), preset.name),
            found: format!("{} other .json files below {}", found.len(), folder.display()),
        }
    })
}
