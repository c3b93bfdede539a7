//! Where two runs find data, indices and imported files. Places do not identify a run: rows have the hashes of the data and files that
//! they were computed from, records those of indices and of the lists of scenes.

use std::collections::BTreeMap;
use std::path::{Component, Path, PathBuf};

use super::{MethodRecord, PresetRecord, Provenance, WarningCount};
use crate::RunWarning;

/// How the description of a sampled index begins; the rule's name or path follows.
pub const SAMPLED_BY: &str = "sampled by ";
/// The parameter of an imported method that names its folder.
const FOLDER: &str = "folder";

/// Data and imported files that a run finds in another place than the results that it resumes have them from: both places, theirs
/// first.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Moved {
    /// Both places of the data, by the name of the preset.
    pub data: BTreeMap<String, [String; 2]>,
    /// Both places of imported files, by the name of the method.
    pub files: BTreeMap<String, [String; 2]>,
}

impl Provenance {
    /// What another run finds in another place than this one.
    pub(crate) fn moved(&self, other: &Self) -> Moved {
        let of_preset = |preset: &PresetRecord| {
            let known = self.preset(&preset.name)?;
            Some((preset.name.clone(), elsewhere(&known.dataset, &preset.dataset)?))
        };
        let of_method = |method: &MethodRecord| {
            let known = self.method(&method.name)?;
            Some((method.name.clone(), elsewhere(known.folder()?, method.folder()?)?))
        };
        Moved {
            data: other.presets.iter().filter_map(of_preset).collect(),
            files: other.methods.iter().filter_map(of_method).collect(),
        }
    }

    /// Takes over the other places of a run that has resumed these results, whose data and files have the same contents.
    pub(crate) fn take_places(&mut self, run: &Self) {
        let moved = self.moved(run);
        for known in self.presets.iter_mut().filter(|known| moved.data.contains_key(&known.name)) {
            if let Some(found) = run.preset(&known.name) {
                *known = known.clone().with_places_of(found);
            }
        }
        for known in self.methods.iter_mut().filter(|known| moved.files.contains_key(&known.name)) {
            if let Some(found) = run.method(&known.name) {
                *known = known.clone().with_places_of(found);
            }
        }
    }

    /// Counts another part of a run among those whose data are in another place than here, and under each of its presets for each
    /// method whose files are in another folder: without a common row, nothing says whether their contents agree.
    pub(super) fn warn_of_other_places(&mut self, other: &Self) {
        let moved = self.moved(other);
        for PresetRecord { name, .. } in &other.presets {
            let data = moved.data.get(name).map(|places| (RunWarning::OtherData.to_string(), places));
            let files = moved.files.iter().map(|(method, places)| (RunWarning::OtherFolder.about(method), places));
            for (kind, [first, found]) in data.into_iter().chain(files) {
                match self.warnings.iter_mut().find(|known| known.preset == *name && known.kind == kind) {
                    Some(known) => known.count += 1,
                    None => self.warnings.push(WarningCount {
                        preset: name.clone(),
                        kind,
                        count: 1,
                        example: format!("{found}; the first is {first}"),
                    }),
                }
            }
        }
    }
}

impl PresetRecord {
    /// Names the data as `known` does, with the list of their scenes, and the index if it has the same entries or is in the same
    /// place.
    pub(super) fn with_places_of(self, known: &Self) -> Self {
        let same_index = self.index_sha256 == known.index_sha256 || is_same(&self.index, &known.index);
        Self {
            dataset: known.dataset.clone(),
            scenes_sha256: known.scenes_sha256.clone(),
            index: if same_index { known.index.clone() } else { self.index },
            ..self
        }
    }
}

impl MethodRecord {
    /// Names the folder of an imported method as `known` does.
    fn with_places_of(mut self, known: &Self) -> Self {
        if let Some(folder) = self.folder().and(known.folder()).map(str::to_owned) {
            self.parameters.insert(FOLDER.to_owned(), folder.into());
        }
        self
    }

    /// Names its folder as the record of the method of its name does, if there is one.
    pub(crate) fn with_places_recorded_in(self, provenance: &Provenance) -> Self {
        match provenance.method(&self.name) {
            Some(known) => self.with_places_of(known),
            None => self,
        }
    }

    /// Whether its files are in another folder.
    pub(crate) fn is_elsewhere(&self, known: &Self) -> bool {
        known.folder().zip(self.folder()).is_some_and(|(first, found)| !is_same(first, found))
    }

    fn folder(&self) -> Option<&str> {
        self.parameters.get(FOLDER)?.as_str()
    }
}

/// Both places, if they differ.
fn elsewhere(first: &str, found: &str) -> Option<[String; 2]> {
    (!is_same(first, found)).then(|| [first, found].map(str::to_owned))
}

fn is_same(first: &str, second: &str) -> bool {
    first == second || place(first) == place(second)
}

/// A description with its path in canonical form. A remark may follow the path after a comma; a path that does not exist on
/// this machine only loses `.` and what is redundant between its components.
fn place(text: &str) -> String {
    let (before, path) = text.strip_prefix(SAMPLED_BY).map_or(("", text), |path| (SAMPLED_BY, path));
    let mut ends: Vec<usize> = path.match_indices(", ").map(|(at, _)| at).collect();
    ends.push(path.len());
    let canonical = |end: &usize| {
        let (path, remark) = path.split_at(*end);
        Some(format!("{before}{}{remark}", Path::new(path).canonicalize().ok()?.display()))
    };
    let plain = || {
        let parts = Path::new(path).components().filter(|part| *part != Component::CurDir);
        format!("{before}{}", parts.collect::<PathBuf>().display())
    };
    ends.iter().rev().find_map(canonical).unwrap_or_else(plain)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_index_of_the_same_content_is_the_same_wherever_it_is() {
        let record = |index: &str, hash: &str| PresetRecord {
            index: index.to_owned(),
            index_sha256: hash.to_owned(),
            ..PresetRecord::default()
        };
        let named = |other: PresetRecord| other.with_places_of(&record("a/index.json", "1")).index;
        assert_eq!(named(record("b/copy.json", "1")), "a/index.json");
        assert_eq!(named(record("b/copy.json", "2")), "b/copy.json");
    }

    #[test]
    fn a_place_has_several_names() {
        let folder = tempfile::tempdir().unwrap();
        std::fs::create_dir_all(folder.path().join("data/test")).unwrap();
        let at = |path: &str| folder.path().join(path).display().to_string();
        for name in ["data/test/", "./data/test", "data/../data/test/."] {
            assert!(is_same(&at("data/test"), &at(name)), "{name}");
            let cropped = |path: &str| format!("{}, cropped", at(path));
            assert!(is_same(&cropped("data/test"), &cropped(name)) && !is_same(&cropped("data/test"), &at(name)));
            let sampled = |path: &str| format!("{SAMPLED_BY}{}", at(path));
            assert!(is_same(&sampled("data/test"), &sampled(name)) && !is_same(&sampled("data/test"), &at(name)));
        }
        assert!(!is_same(&at("data"), &at("data/test")));
        assert!(is_same("gone/test", "./gone//test/") && !is_same("gone/test", "gone/../test"));
        assert!(is_same("s3://shelf/data", "s3://shelf/data/") && !is_same("s3://shelf/data", "s3://shelf/date"));
    }
}
