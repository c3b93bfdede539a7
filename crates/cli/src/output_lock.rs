//! The exclusive right to write to the folder of a command's output.

use std::io::Result as IoResult;
use std::path::{Path, PathBuf};

use anyhow::bail;
use atsplat_files::FolderLock;

use crate::paths::NewFolders;

/// A folder that no other process writes to. Dropped, the folders that were created for it are removed again, if nothing was
/// written.
#[derive(Debug)]
pub(crate) struct OutputLock {
    lock: Option<FolderLock>,
    folder: PathBuf,
    /// After the lock, which is a file in them.
    _folders: NewFolders,
}

impl OutputLock {
    /// Creates the folder if it is missing, and locks it.
    ///
    /// # Errors
    /// If another process writes to it, or it cannot be written to.
    pub(crate) fn of(folder: &Path) -> anyhow::Result<Self> {
        let folders = NewFolders::of(folder)?;
        if let Some(file) = FolderLock::would_replace(folder) {
            bail!("the lock of the folder would replace {}: choose another folder", file.display());
        }
        Ok(Self { lock: Some(FolderLock::of(folder)?), folder: folder.to_owned(), _folders: folders })
    }

    /// Whether a folder has nothing in it but its lock and these `files`.
    pub(crate) fn is_alone(folder: &Path, files: &[&str]) -> IoResult<bool> {
        let names = folder.read_dir()?.map(|entry| entry.map(|entry| entry.file_name()));
        let names = names.collect::<IoResult<Vec<_>>>()?;
        Ok(names.iter().all(|name| FolderLock::FILES.iter().chain(files).any(|own| name == own)))
    }
}

impl Drop for OutputLock {
    fn drop(&mut self) {
        drop(self.lock.take());
        if Self::is_alone(&self.folder, &[]).unwrap_or(false) {
            FolderLock::remove_from(&self.folder);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_folder_is_locked_once_and_removed_if_nothing_is_written() {
        let root = tempfile::tempdir().unwrap();
        let folder = root.path().join("new/out");
        let lock = OutputLock::of(&folder).unwrap();
        let error = OutputLock::of(&folder).unwrap_err().to_string();
        assert!(error.contains("is being written by process "), "{error}");
        drop(lock);
        assert!(!root.path().join("new").exists(), "nothing was written");
        let lock = OutputLock::of(&folder).unwrap();
        std::fs::write(folder.join("image"), b"").unwrap();
        drop(lock);
        assert!(folder.join("image").is_file() && FolderLock::was_taken(&folder));
        assert!(OutputLock::is_alone(&folder, &["image"]).unwrap() && !OutputLock::is_alone(&folder, &[]).unwrap());
        assert!(OutputLock::of(&folder).is_ok(), "free again");
    }

    #[test]
    fn a_file_of_the_user_is_not_replaced() {
        let folder = tempfile::tempdir().unwrap();
        let own = folder.path().join("run.json");
        std::fs::write(&own, br#"{ "pid": 7 }"#).unwrap();
        let error = OutputLock::of(folder.path()).unwrap_err().to_string();
        assert!(error.contains("run.json: choose another folder"), "{error}");
        assert_eq!(std::fs::read(&own).unwrap(), br#"{ "pid": 7 }"#);
        std::fs::write(&own, br#"{ "pid": 7, "host": "a", "since": 1 }"#).unwrap();
        drop(OutputLock::of(folder.path()).unwrap());
        assert!(!own.exists(), "left by a process that was killed");
    }
}
