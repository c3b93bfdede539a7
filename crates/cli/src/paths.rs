//! Paths of arguments: outputs that would replace what is read, and files and folders that a command creates before its work
//! and removes if it fails.

use std::ffi::OsStr;
use std::io::{Result as IoResult, Write as _};
use std::path::{Component, Path, PathBuf, absolute};

use anyhow::{Context as _, ensure};
use atsplat_files::{AtomicFile, Writer};

use crate::parse::is_toml;

/// The canonical path of a file or folder; of a missing one, that of the lowest folder above it that is there, with the rest.
pub(crate) fn canonical_path(path: &Path) -> IoResult<PathBuf> {
    Path::new(".").join(path).canonicalize().or_else(|_missing| {
        let path = absolute(path)?;
        let mut above = path.ancestors().skip(1);
        let Some((folder, mut canonical)) = above.find_map(|folder| Some((folder, folder.canonicalize().ok()?))) else {
            return Ok(path);
        };
        for part in path.strip_prefix(folder).unwrap_or(&path).components() {
            match part {
                Component::ParentDir => drop(canonical.pop()),
                part => canonical.push(part),
            }
        }
        Ok(canonical)
    })
}

/// What a command reads, for [`check_output`].
#[derive(Clone, Copy, Debug)]
pub(crate) enum Input<'a> {
    /// What it is, such as "the index that is read", and its path. Without a file there, it is the name of something embedded,
    /// or reading it will fail.
    File(&'static str, &'a Path),
    /// What it is, and a name or a path that ends in `.toml`.
    Toml(&'static str, &'a str),
    /// A dataset, a file or a folder, or a folder of depth maps or points.
    Dataset(&'a Path),
}

/// Refuses an output in the place of an input, and one that would be read as a file of an input dataset. `option` names the
/// argument for the message.
pub(crate) fn check_output(option: &str, out: &Path, inputs: &[Input<'_>]) -> anyhow::Result<()> {
    let shown = out.display();
    let places = places(out).with_context(|| format!("{option} {shown}"))?;
    let is_at = |path: &Path| path.canonicalize().is_ok_and(|path| places[0] == path);
    for input in inputs {
        match *input {
            Input::File(what, path) => ensure!(!is_at(path), "{option}: {shown} is {what}: give another file"),
            Input::Toml(what, name) => {
                ensure!(!is_toml(name) || !is_at(Path::new(name)), "{option}: {shown} is {what}: give another file");
            }
            Input::Dataset(data) => ensure!(
                !is_read_with(data, &places),
                "{option}: {shown} has the place of a file of the dataset {}: give another file",
                data.display()
            ),
        }
    }
    Ok(())
}

/// Where a file is: its canonical path, and those that a link in a dataset has, as a file and as a folder.
fn places(file: &Path) -> IoResult<[PathBuf; 3]> {
    let canonical = canonical_path(file)?;
    let Some((folder, name)) = file.parent().zip(file.file_name()) else {
        return Ok([canonical.clone(), canonical.clone(), canonical]);
    };
    let (link, absolute) = (canonical_path(folder)?.join(name), absolute(file)?);
    let goes_up = absolute.components().any(|part| part == Component::ParentDir);
    let as_given = if goes_up { canonical.clone() } else { absolute };
    Ok([canonical, link, as_given])
}

/// Whether the file at these places is the dataset, or would be read with it. A dataset may be elsewhere, or missing.
fn is_read_with(data: &Path, places: &[PathBuf]) -> bool {
    let Ok(canonical) = data.canonicalize() else { return false };
    let mut named = places.iter().filter(|place| is_name_of_dataset(place));
    if data.is_dir() {
        let as_given = absolute(data).unwrap_or_else(|_unknown| canonical.clone());
        return named.any(|place| place.starts_with(&canonical) || place.starts_with(&as_given));
    }
    places.contains(&canonical) || named.any(|place| place.parent() == canonical.parent())
}

/// Whether a format of datasets reads files of this name: cameras and points by their names alone, images and depth maps if
/// they are there.
fn is_name_of_dataset(place: &Path) -> bool {
    const IMAGES: [&str; 5] = ["jpg", "jpeg", "png", "webp", "exr"];
    let text = |part: Option<&OsStr>| part.map(|part| part.to_string_lossy().into_owned()).unwrap_or_default();
    let (name, extension) = (text(place.file_name()), text(place.extension()));
    match (name.as_str(), extension.as_str()) {
        ("transforms.json" | "render.json" | "cameras.bin" | "images.bin" | "points3D.bin", _)
        | (_, "txt" | "torch") => true,
        ("index.json", _) => place.parent().is_some_and(holds_chunks),
        (_, extension) => place.is_file() && IMAGES.iter().any(|image| image.eq_ignore_ascii_case(extension)),
    }
}

/// Whether pixelSplat's chunks are in the folder: their index is next to them.
fn holds_chunks(folder: &Path) -> bool {
    let is_chunk = |path: PathBuf| path.extension().is_some_and(|extension| extension == "torch");
    folder.read_dir().is_ok_and(|entries| entries.flatten().any(|entry| is_chunk(entry.path())))
}

/// Folders that were created before the work started. Dropped, those that are still empty are removed: a command that fails
/// leaves none behind.
#[derive(Debug, Default)]
pub(crate) struct NewFolders(Vec<PathBuf>);

impl NewFolders {
    /// Creates a folder, and those above it that are missing.
    pub(crate) fn of(folder: &Path) -> anyhow::Result<Self> {
        let mut folders = Self::default();
        folders.create(folder)?;
        Ok(folders)
    }

    /// Creates the folder of a file.
    pub(crate) fn create_for(&mut self, file: &Path) -> anyhow::Result<()> {
        file.parent().filter(|folder| !folder.as_os_str().is_empty()).map_or(Ok(()), |folder| self.create(folder))
    }

    fn create(&mut self, folder: &Path) -> anyhow::Result<()> {
        let is_missing = |folder: &&Path| !folder.as_os_str().is_empty() && !folder.exists();
        let missing: Vec<&Path> = folder.ancestors().take_while(is_missing).collect();
        self.0.extend(missing.into_iter().rev().map(Path::to_owned));
        std::fs::create_dir_all(folder).with_context(|| format!("creating the folder {}", folder.display()))
    }
}

impl Drop for NewFolders {
    fn drop(&mut self) {
        // From the inside out. One that holds something cannot be removed.
        for folder in self.0.iter().rev() {
            std::fs::remove_dir(folder).ok();
        }
    }
}

/// A file opened before long work starts, which replaces its target only when the work is done.
#[derive(Debug)]
pub(crate) struct PendingFile {
    /// Before the folders, which are empty only without its temporary file.
    file: AtomicFile,
    _folders: NewFolders,
}

impl PendingFile {
    /// Opens a temporary file next to `target`, creating missing folders.
    pub(crate) fn open(target: &Path) -> anyhow::Result<Self> {
        let mut folders = NewFolders::default();
        folders.create_for(target)?;
        let file = AtomicFile::create(target).with_context(|| format!("writing {}", target.display()))?;
        Ok(Self { file, _folders: folders })
    }

    /// Writes the contents and moves the file to its target.
    pub(crate) fn finish(self, bytes: &[u8]) -> anyhow::Result<()> {
        self.writer().write_all(bytes).with_context(|| format!("writing {}", self.file.target().display()))?;
        self.commit()
    }

    /// A writer for incremental output.
    pub(crate) fn writer(&self) -> Writer {
        self.file.writer()
    }

    /// Moves the file to its target.
    pub(crate) fn commit(self) -> anyhow::Result<()> {
        let writing = format!("writing {}", self.file.target().display());
        self.file.commit().map(drop).context(writing)
    }
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::*;

    /// A dataset in `data`, and what is allowed and refused next to its files.
    #[test]
    fn outputs_in_the_place_of_inputs_are_refused() {
        let root = tempfile::tempdir().unwrap();
        let at = |path: &str| root.path().join(path);
        fs::create_dir_all(at("data/test")).unwrap();
        for file in ["data/transforms.json", "data/0.PNG", "data/test/000.torch", "index", "map.toml", "map"] {
            fs::write(at(file), "").unwrap();
        }
        let (data, index, map) = (at("data"), at("index"), at("map.toml"));
        let name = map.to_string_lossy().into_owned();
        let inputs =
            [Input::File("the index that is read", &index), Input::Toml("the key map", &name), Input::Dataset(&data)];
        let check = |path: &str| check_output("--out", &at(path), &inputs).map_err(|error| error.to_string());
        for (path, expected) in [
            ("index", "index is the index that is read: give another file"),
            ("data/../index", "is the index that is read"),
            ("new/../index", "is the index that is read"),
            ("map.toml", "map.toml is the key map: give another file"),
            ("data/transforms.json", "transforms.json has the place of a file of the dataset "),
            ("data/new/../sparse/0/cameras.bin", "of the dataset "),
            ("data/scene.txt", "of the dataset "),
            ("data/0.PNG", "of the dataset "),
            ("data/test/index.json", "of the dataset "),
        ] {
            let error = check(path).unwrap_err();
            assert!(error.starts_with("--out: ") && error.contains(expected), "{path}: {error}");
        }
        for path in
            ["index.json", "map", "data/index.json", "data/1.PNG", "data/fitted.ply", "transforms.json", "data2/a.txt"]
        {
            assert_eq!(check(path), Ok(()), "{path}");
        }
        let file = at("data/transforms.json");
        let of_file = |path: &str| check_output("--out", &at(path), &[Input::Dataset(&file)]).is_ok();
        assert!(!of_file("data/transforms.json") && !of_file("data/images.txt") && of_file("data/test/images.txt"));
        assert_eq!(check_output("--out", &at("new"), &[Input::File("weights", Path::new("micro"))]).ok(), Some(()));
    }

    #[cfg(unix)]
    #[test]
    fn files_are_found_behind_links() {
        use std::os::unix::fs::symlink;

        let root = tempfile::tempdir().unwrap();
        let at = |path: &str| root.path().join(path);
        fs::create_dir(at("data")).unwrap();
        symlink(at("data"), at("link")).unwrap();
        check_output("--out", &at("link/transforms.json"), &[Input::Dataset(&at("data"))]).unwrap_err();
        check_output("--out", &at("link/a/b.txt"), &[Input::Dataset(&at("data"))]).unwrap_err();
        check_output("--out", &at("link/a.json"), &[Input::Dataset(&at("data"))]).unwrap();
        // A file and a folder of a dataset that are elsewhere.
        fs::create_dir(at("elsewhere")).unwrap();
        fs::write(at("elsewhere/blob"), "").unwrap();
        symlink(at("elsewhere"), at("data/scene")).unwrap();
        symlink(at("elsewhere/blob"), at("data/transforms.json")).unwrap();
        check_output("--out", &at("data/transforms.json"), &[Input::Dataset(&at("data"))]).unwrap_err();
        check_output("--out", &at("data/scene/transforms.json"), &[Input::Dataset(&at("data"))]).unwrap_err();
        check_output("--out", &at("elsewhere/transforms.json"), &[Input::Dataset(&at("data"))]).unwrap();
    }

    #[test]
    fn new_folders_stay_only_if_something_is_in_them() {
        let root = tempfile::tempdir().unwrap();
        let [old, kept, file] = ["old", "new/kept", "new/empty/above/file"].map(|path| root.path().join(path));
        fs::create_dir(&old).unwrap();
        let mut folders = NewFolders::of(&old).unwrap();
        folders.create_for(&old.join("empty/file")).unwrap();
        folders.create(&kept).unwrap();
        drop(PendingFile::open(&file).unwrap());
        assert!(!root.path().join("new/empty").exists(), "the folders of a file that was not written");
        PendingFile::open(&file).unwrap().finish(b"written").unwrap();
        drop(folders);
        assert!(old.is_dir() && !old.join("empty").exists() && !kept.exists() && file.is_file());
        assert!(NewFolders::of(&file.join("inside")).is_err(), "a file in the place of a folder");
    }
}
