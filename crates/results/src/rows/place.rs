//! Whether two records name one file or folder.

use std::path::{Component, Path, PathBuf};

use super::{MethodRecord, PresetRecord};

/// How the description of a sampled index begins; the rule's name or path follows.
pub const SAMPLED_BY: &str = "sampled by ";
/// The parameter of an imported method that names its folder.
const FOLDER: &str = "folder";

impl PresetRecord {
    /// Names data and index as `known` does, if the data are in the same place, and the index is there too or has the same content: the
    /// machines of a cluster may have it under several paths.
    pub(super) fn with_places_of(self, known: &Self) -> Self {
        let same_index = self.index_sha256 == known.index_sha256 || is_same(&self.index, &known.index);
        let same_dataset = is_same(&self.dataset, &known.dataset);
        Self {
            dataset: if same_dataset { known.dataset.clone() } else { self.dataset },
            index: if same_index { known.index.clone() } else { self.index },
            ..self
        }
    }
}

impl MethodRecord {
    /// Names the folder of an imported method as `known` does, if it is the same.
    pub(super) fn with_places_of(mut self, known: &Self) -> Self {
        let folder = |record: &Self| record.parameters.get(FOLDER)?.as_str().map(str::to_owned);
        let same_folder = folder(&self).zip(folder(known)).filter(|(folder, known)| is_same(folder, known));
        if let Some((_, known)) = same_folder {
            self.parameters.insert(FOLDER.to_owned(), known.into());
        }
        self
    }
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
