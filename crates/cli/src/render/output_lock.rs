//! The exclusive right to write to the folder of a command's output.

use std::io::{ErrorKind, Result as IoResult};
use std::path::{Path, PathBuf};

use anyhow::ensure;
use atsplat_files::FolderLock;
use serde_json::Value;

use crate::paths::NewFolders;

/// The file that [`FolderLock`] locks; it stays behind.
const LOCK: &str = "run.lock";
/// The file in which it says by whom, while it is locked.
const HOLDER: &str = "run.json";

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
        let holder = folder.join(HOLDER);
        ensure!(
            is_replaceable(&holder),
            "the lock of the folder would replace {}: choose another folder",
            holder.display()
        );
        Ok(Self { lock: Some(FolderLock::of(folder)?), folder: folder.to_owned(), _folders: folders })
    }

    /// Whether a folder was locked at any time.
    pub(crate) fn was_taken(folder: &Path) -> bool {
        folder.join(LOCK).is_file()
    }

    /// Whether a folder has nothing in it but its lock and one more `file`.
    pub(crate) fn is_alone(folder: &Path, file: &str) -> IoResult<bool> {
        let names = folder.read_dir()?.map(|entry| entry.map(|entry| entry.file_name()));
        let names = names.collect::<IoResult<Vec<_>>>()?;
        Ok(names.iter().all(|name| [LOCK, HOLDER, file].iter().any(|own| name == own)))
    }
}

impl Drop for OutputLock {
    fn drop(&mut self) {
        drop(self.lock.take());
        if Self::is_alone(&self.folder, LOCK).unwrap_or(false) {
            // A lock that stays behind is locked again by the next process.
            std::fs::remove_file(self.folder.join(LOCK)).ok();
        }
    }
}

/// Whether a file is missing, or is the one in which a lock names its process and no file of a user's.
fn is_replaceable(holder: &Path) -> bool {
    let bytes = match std::fs::read(holder) {
        Ok(bytes) => bytes,
        Err(error) => return error.kind() == ErrorKind::NotFound,
    };
    let found: Value = serde_json::from_slice(&bytes).unwrap_or_default();
    ["pid", "host", "since"].iter().all(|field| found.get(field).is_some())
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
        assert!(folder.join("image").is_file() && OutputLock::was_taken(&folder));
        assert!(OutputLock::is_alone(&folder, "image").unwrap() && !OutputLock::is_alone(&folder, LOCK).unwrap());
        assert!(OutputLock::of(&folder).is_ok(), "free again");
    }

    #[test]
    fn a_file_of_the_user_is_not_replaced() {
        let folder = tempfile::tempdir().unwrap();
        let own = folder.path().join(HOLDER);
        std::fs::write(&own, br#"{ "pid": 7 }"#).unwrap();
        let error = OutputLock::of(folder.path()).unwrap_err().to_string();
        assert!(error.contains("run.json: choose another folder"), "{error}");
        assert_eq!(std::fs::read(&own).unwrap(), br#"{ "pid": 7 }"#);
        std::fs::write(&own, br#"{ "pid": 7, "host": "a", "since": 1 }"#).unwrap();
        drop(OutputLock::of(folder.path()).unwrap());
        assert!(!own.exists(), "left by a process that was killed");
    }
}
