use std::fs;
use std::path::{Path, PathBuf};

use atsplat_files::Sha256Digest;
use atsplat_protocol::Preset;

use crate::EvalError;

/// Larger files are not searched: the largest published index has 1.2 MB.
const MAX_BYTES: u64 = 64 << 20;
/// Depth to which folders are searched for indices.
const MAX_DEPTH: usize = 4;

/// The JSON files in a folder and those below it, by their hashes: each was read once, however many protocols are looked up.
#[derive(Clone, Debug)]
pub struct IndexFolder {
    folder: PathBuf,
    /// In the order of their paths.
    files: Vec<(Sha256Digest, PathBuf)>,
    /// Such as `lost+found`, which only the administrator may read.
    unread: Vec<PathBuf>,
}

impl IndexFolder {
    /// Reads the files.
    ///
    /// # Errors
    /// [`EvalError::Io`] if the folder itself cannot be read.
    pub fn search(folder: &Path) -> Result<Self, EvalError> {
        let (mut files, mut unread) = (Vec::new(), Vec::new());
        let mut folders = vec![(folder.to_owned(), 0)];
        while let Some((folder, depth)) = folders.pop() {
            let entries = match fs::read_dir(&folder) {
                Ok(entries) => entries,
                Err(_) if depth > 0 => {
                    unread.push(folder);
                    continue;
                }
                Err(error) => return Err(EvalError::io("searching for evaluation indices", &folder)(error)),
            };
            for path in entries.flatten().map(|entry| entry.path()) {
                let is_json = path.extension().is_some_and(|extension| extension == "json");
                if path.is_dir() && depth < MAX_DEPTH {
                    folders.push((path, depth + 1));
                } else if is_json && fs::metadata(&path).is_ok_and(|data| data.is_file() && data.len() <= MAX_BYTES) {
                    match fs::read(&path) {
                        Ok(bytes) => files.push((Sha256Digest::of(&bytes), path)),
                        Err(_) => unread.push(path),
                    }
                }
            }
        }
        files.sort_by(|(_, a), (_, b)| a.cmp(b));
        Ok(Self { folder: folder.to_owned(), files, unread })
    }

    /// The first of a preset's accepted indices that is there, in any subfolder and under any name.
    ///
    /// # Errors
    /// [`EvalError::Settings`] if none is.
    pub fn published(&self, preset: &Preset) -> Result<&Path, EvalError> {
        let accepted = &preset.index.accepted;
        let by_hash = |sha256: &Sha256Digest| self.files.iter().find(|(hash, _)| hash == sha256);
        if let Some((_, path)) = accepted.iter().find_map(|accepted| by_hash(&accepted.sha256)) {
            return Ok(path);
        }
        let names: Vec<&str> = accepted.iter().map(|accepted| accepted.name.as_str()).collect();
        let unread = self.unread.first().map_or_else(String::new, |first| {
            format!(", and {} that cannot be read, such as {}", self.unread.len(), first.display())
        });
        Err(EvalError::Settings {
            what: "evaluation index",
            expected: format!("the file of {} for the preset {}", names.join(" or "), preset.name),
            found: format!("{} other .json files below {}{unread}", self.files.len(), self.folder.display()),
        })
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use atsplat_scene::{Scene, SceneError, SceneSource, Warnings};

    use super::*;
    use crate::runner::{Dataset, IndexChoice};

    /// No scene: only the index matters.
    struct Nothing;

    impl SceneSource for Nothing {
        fn keys(&self) -> &[String] {
            &[]
        }

        fn load(&self, key: &str, _warnings: &mut Warnings) -> Result<Scene, SceneError> {
            Err(SceneError::UnknownScene { key: key.to_owned(), path: "nothing".into() })
        }
    }

    /// Files that change after the search are not read again, except for the index that is used.
    #[test]
    fn one_search_finds_the_indices_of_several_protocols() {
        let folder = tempfile::tempdir().unwrap();
        let below = folder.path().join("a/b");
        fs::create_dir_all(&below).unwrap();
        let published = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../eval/indices");
        for (name, copy) in [("rooms-2v", "renamed"), ("yards-4v", "another")] {
            fs::copy(published.join(format!("{name}.json")), below.join(format!("{copy}.json"))).unwrap();
        }
        fs::write(folder.path().join("transforms.json"), "{}").unwrap();
        let found = IndexFolder::search(folder.path()).unwrap();
        fs::remove_file(folder.path().join("transforms.json")).unwrap();
        fs::copy(published.join("yards-2v.json"), below.join("later.json")).unwrap();
        let index_of = |name: &str| {
            let (preset, source, choice) =
                (Preset::named(name).unwrap(), Arc::new(Nothing), IndexChoice::Below(&found));
            let opened = Dataset::new(preset, source, folder.path(), choice, false, &mut Warnings::new());
            opened.map(|dataset| dataset.index)
        };
        for (preset, name, copy) in
            [("rooms-2v-128", "rooms-2v", "renamed.json"), ("yards-4v-128x224", "yards-4v", "another.json")]
        {
            let index = index_of(preset).unwrap();
            assert_eq!(index.name.as_deref(), Some(name), "{preset}");
            assert!(index.description.ends_with(copy), "{}", index.description);
        }
        let missing = index_of("yards-2v-128x224").unwrap_err().to_string();
        assert!(missing.contains("found 3 other .json files below "), "{missing}");
    }
}
