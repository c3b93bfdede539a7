use std::path::{Path, PathBuf};
use std::{fs, io};

use atsplat_files::Sha256Digest;
use atsplat_protocol::Preset;

use crate::EvalError;
use crate::folder_walk::{FolderWalk, LeftOut, VisitedFolder};

/// Larger files are not searched: the largest published index has 1.2 MB.
const MAX_BYTES: u64 = 64 << 20;

/// The JSON files in a folder and those below it, by their hashes: each was read once, however many protocols are looked up.
#[derive(Clone, Debug)]
pub struct IndexFolder {
    folder: PathBuf,
    /// In the order of their paths.
    files: Vec<(Sha256Digest, PathBuf)>,
    /// Folders and files, and why: hidden folders, large files, or `lost+found`, which only the administrator may read.
    not_searched: Vec<(PathBuf, String)>,
}

impl IndexFolder {
    /// Reads the files.
    ///
    /// # Errors
    /// [`EvalError::Io`] if the folder itself cannot be read.
    pub fn search(folder: &Path) -> Result<Self, EvalError> {
        fs::read_dir(folder).map_err(EvalError::io("searching for evaluation indices", folder))?;
        let (mut files, mut not_searched) = (Vec::new(), Vec::new());
        let mut walk = FolderWalk::from(folder);
        while let Some(VisitedFolder { folders, files: found, .. }) = walk.visit_next() {
            for path in found.into_iter().filter(|path| path.extension().is_some_and(|extension| extension == "json")) {
                match hash_of(&path) {
                    Ok(hash) => files.push((hash, path)),
                    Err(why) => not_searched.push((path, why)),
                }
            }
            walk.enter(folders);
        }
        let left_out = walk.left_out().into_iter().filter(|(_, why)| !matches!(why, LeftOut::Visited(_)));
        not_searched.extend(left_out.map(|(path, why)| (path, why.to_string())));
        files.sort_by(|(_, a), (_, b)| a.cmp(b));
        not_searched.sort();
        Ok(Self { folder: folder.to_owned(), files, not_searched })
    }

    /// Folders and files that were not searched, in the order of their paths, and why.
    pub(crate) fn not_searched(&self) -> &[(PathBuf, String)] {
        &self.not_searched
    }

    /// The first of a preset's accepted indices that is there, in any subfolder and under any name.
    ///
    /// # Errors
    /// [`EvalError::NoPublishedIndex`] if none is.
    pub fn published(&self, preset: &Preset) -> Result<&Path, EvalError> {
        let accepted = &preset.index.accepted;
        let by_hash = |sha256: &Sha256Digest| self.files.iter().find(|(hash, _)| hash == sha256);
        if let Some((_, path)) = accepted.iter().find_map(|accepted| by_hash(&accepted.sha256)) {
            return Ok(path);
        }
        let names: Vec<&str> = accepted.iter().map(|accepted| accepted.name.as_str()).collect();
        let not_searched = self.not_searched.first().map_or_else(String::new, |(first, why)| {
            let count = self.not_searched.len();
            format!(", and {count} files or folders that were not searched, such as {} ({why})", first.display())
        });
        Err(EvalError::NoPublishedIndex {
            expected: format!("the file of {} for the preset {}", names.join(" or "), preset.name),
            found: format!("{} other .json files below {}{not_searched}", self.files.len(), self.folder.display()),
        })
    }
}

/// The hash of a file's bytes, or why it is not read.
fn hash_of(path: &Path) -> Result<Sha256Digest, String> {
    let unreadable = |error: io::Error| format!("cannot be read: {error}");
    let data = fs::metadata(path).map_err(unreadable)?;
    if !data.is_file() {
        return Err("not a file".to_owned());
    }
    if data.len() > MAX_BYTES {
        return Err(format!("larger than {} MiB", MAX_BYTES >> 20));
    }
    fs::read(path).map(|bytes| Sha256Digest::of(&bytes)).map_err(unreadable)
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
        let missing = index_of("yards-2v-128x224").unwrap_err();
        let text = missing.to_string();
        assert!(text.starts_with("evaluation index: expected the file of yards-2v"), "{text}");
        assert!(text.contains("found 3 other .json files below "), "{text}");
        assert!(matches!(missing, EvalError::NoPublishedIndex { .. }), "no wrong setting: {text}");
    }

    /// One index is six folders deep, the other in a hidden folder.
    #[test]
    fn indices_are_found_at_any_depth_and_what_is_not_searched_is_named() {
        let folder = tempfile::tempdir().unwrap();
        let published = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../eval/indices");
        let [deep, hidden] = ["1/2/3/4/5/6", ".cache"].map(|name| folder.path().join(name));
        for (name, below) in [("rooms-2v", &deep), ("yards-4v", &hidden)] {
            fs::create_dir_all(below).unwrap();
            fs::copy(published.join(format!("{name}.json")), below.join("index.json")).unwrap();
        }
        fs::File::create(folder.path().join("large.json")).unwrap().set_len(MAX_BYTES + 1).unwrap();
        let found = IndexFolder::search(folder.path()).unwrap();
        assert_eq!(found.published(&Preset::named("rooms-2v-128").unwrap()).unwrap(), deep.join("index.json"));
        let missing = found.published(&Preset::named("yards-4v-128x224").unwrap()).unwrap_err().to_string();
        let not_searched = format!("2 files or folders that were not searched, such as {} (hidden)", hidden.display());
        assert!(missing.contains(&not_searched), "{missing}");
        assert_eq!(found.not_searched()[1], (folder.path().join("large.json"), "larger than 64 MiB".to_owned()));
    }
}
