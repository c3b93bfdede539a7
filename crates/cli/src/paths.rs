//! Files and folders that a command creates before its work starts, and removes if it fails.

use std::io::Write as _;
use std::path::{Path, PathBuf};

use anyhow::Context as _;
use atsplat_files::{AtomicFile, Sha256Digest, Writer, create_folder};
use serde::Serialize;

use crate::objects::with_urls;

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
        create_folder(folder).with_context(|| format!("creating the folder {}", folder.display()))
    }
}

impl Drop for NewFolders {
    fn drop(&mut self) {
        // From the inside out. One that is not empty cannot be removed.
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

    pub(crate) fn target(&self) -> &Path {
        self.file.target()
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

/// Fails if a file cannot be written. It is closed again: a command that is interrupted or killed leaves no part of it.
pub(crate) fn check_writable(file: &Path) -> anyhow::Result<()> {
    PendingFile::open(file).map(drop)
}

/// Removes a file that an earlier run wrote next to its output, such as its record: it says nothing about the output of this run.
pub(crate) fn remove_old(file: &Path) -> anyhow::Result<()> {
    atsplat_files::remove_if_exists(file).with_context(|| format!("removing {}", file.display()))
}

/// Where the record of a file is. `scene.ply.json` is sorted next to its scene, and not a file name that a dataset may have.
pub(crate) fn record_path(file: &Path) -> PathBuf {
    file.with_added_extension("json")
}

/// Writes the record of a file, which is written already, with its hash: a file that was replaced since has another. Copies of objects
/// are named by their URLs.
pub(crate) fn write_record<R: Serialize>(record: &R, file: &Path) -> anyhow::Result<()> {
    let file_sha256 = Sha256Digest::of_file(file).with_context(|| format!("reading {}", file.display()))?;
    let text = serde_json::to_string_pretty(&RecordOfFile { record, file_sha256 })?;
    PendingFile::open(&record_path(file))?.finish(format!("{}\n", with_urls(&text)).as_bytes())
}

#[derive(Serialize)]
struct RecordOfFile<'a, R> {
    #[serde(flatten)]
    record: &'a R,
    #[serde(rename = "file-sha256")]
    file_sha256: Sha256Digest,
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;
    use std::fs;

    use super::*;
    use crate::objects::note_copy;

    #[test]
    fn a_record_has_the_hash_of_its_file_and_names_objects_by_their_urls() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("a.ply");
        fs::write(&file, "abc").unwrap();
        note_copy(Path::new("/nowhere/trees/44/data"), "s3://b/data3");
        write_record(&BTreeMap::from([("warnings", ["no /nowhere/trees/44/data/0.png"])]), &file).unwrap();
        let record = fs::read_to_string(folder.path().join("a.ply.json")).unwrap();
        let record: serde_json::Value = serde_json::from_str(&record).unwrap();
        let hash = Sha256Digest::of(b"abc").to_string();
        assert_eq!(record, serde_json::json!({ "warnings": ["no s3://b/data3/0.png"], "file-sha256": hash }));
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
        let shown = file.display().to_string();
        let error = format!("{:#}", NewFolders::of(&file.join("inside")).unwrap_err());
        assert_eq!(error, format!("creating the folder {shown}/inside: expected a folder, found the file {shown}"));
    }
}
