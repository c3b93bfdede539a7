//! The exclusive right to write a command's output: to its folder, or to single files.

use std::io::Result as IoResult;
use std::path::Path;

use anyhow::Context as _;
use atsplat_files::{FileLock, FolderLock, remove_abandoned};
use atsplat_report::counted;

use crate::paths::{NewFolders, check_writable};
use crate::print::note;

/// A folder that no other process writes to. Dropped, the folders that were created for it are removed again, if nothing was
/// written.
#[derive(Debug)]
pub(crate) struct OutputLock {
    lock: Option<FolderLock>,
    /// After the lock, which is a file in them.
    _folders: NewFolders,
}

impl OutputLock {
    /// Creates the folder if it is missing, locks it, and removes what a process that was killed has left unfinished in it.
    ///
    /// # Errors
    /// If another process writes to it, or it cannot be written to.
    pub(crate) fn of(folder: &Path) -> anyhow::Result<Self> {
        let folders = NewFolders::of(folder)?;
        let lock = Self { lock: Some(FolderLock::of(folder)?), _folders: folders };
        let shown = folder.display();
        let removed = remove_abandoned(folder).with_context(|| format!("removing unfinished files in {shown}"))?;
        if removed > 0 {
            let files = counted(removed, "unfinished file");
            note(&format!("removed {files} from {shown}, of a process that was killed"));
        }
        Ok(lock)
    }

    /// The lock, for what is written into locked folders alone.
    #[expect(clippy::expect_used, reason = "only `drop` takes it")]
    pub(crate) fn folder_lock(&self) -> &FolderLock {
        self.lock.as_ref().expect("taken by `drop`")
    }

    /// Whether a folder contains only its lock and these `files`.
    pub(crate) fn is_alone(folder: &Path, files: &[&str]) -> IoResult<bool> {
        let names = folder.read_dir()?.map(|entry| entry.map(|entry| entry.file_name()));
        let names = names.collect::<IoResult<Vec<_>>>()?;
        Ok(names.iter().all(|name| FolderLock::FILES.iter().chain(files).any(|file| name == file)))
    }
}

impl Drop for OutputLock {
    fn drop(&mut self) {
        if let Some(lock) = self.lock.take().filter(|lock| Self::is_alone(lock.folder(), &[]).unwrap_or(false)) {
            lock.remove();
        }
    }
}

/// Files that no other process writes. Dropped, the folders that were created for them are removed again, if nothing was written.
#[derive(Debug, Default)]
pub(crate) struct OutputFiles {
    locks: Vec<FileLock>,
    /// After the locks, which are files in them.
    folders: NewFolders,
}

impl OutputFiles {
    /// Locks files, as [`Self::add`] does.
    ///
    /// # Errors
    /// As [`Self::add`].
    pub(crate) fn of<'a>(files: impl IntoIterator<Item = &'a Path>) -> anyhow::Result<Self> {
        let mut outputs = Self::default();
        files.into_iter().try_for_each(|file| outputs.add(file))?;
        Ok(outputs)
    }

    /// Creates the folder of a file if it is missing, and locks the file. What belongs to it shares its lock.
    ///
    /// # Errors
    /// If another process writes the file, or it cannot be written.
    pub(crate) fn add(&mut self, file: &Path) -> anyhow::Result<()> {
        self.folders.create_for(file)?;
        check_writable(file)?;
        self.locks.push(FileLock::of(file)?);
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::paths::PendingFile;

    #[test]
    fn a_folder_is_locked_once_and_removed_if_nothing_is_written() {
        let root = tempfile::tempdir().unwrap();
        let folder = root.path().join("new/out");
        let lock = OutputLock::of(&folder).unwrap();
        let error = OutputLock::of(&folder).unwrap_err().to_string();
        assert!(error.contains("is being written by process "), "{error}");
        drop(lock);
        assert_eq!(root.path().join("new").exists(), cfg!(not(unix)), "nothing was written");
        let lock = OutputLock::of(&folder).unwrap();
        std::fs::write(folder.join("image"), b"").unwrap();
        drop(lock);
        assert!(folder.join("image").is_file() && FolderLock::was_taken(&folder));
        assert!(OutputLock::is_alone(&folder, &["image"]).unwrap() && !OutputLock::is_alone(&folder, &[]).unwrap());
        assert!(OutputLock::of(&folder).is_ok(), "free again");
    }

    #[test]
    fn files_are_locked_once_and_their_folders_removed_if_nothing_is_written() {
        let root = tempfile::tempdir().unwrap();
        let [scene, plot] = ["new/a.ply", "new/plots/curve.svg"].map(|path| root.path().join(path));
        let mut files = OutputFiles::default();
        files.add(&scene).unwrap();
        files.add(&plot).unwrap();
        let error = OutputFiles::default().add(&scene).unwrap_err().to_string();
        assert!(error.contains("a.ply is being written by process "), "{error}");
        OutputFiles::default().add(&root.path().join("new/b.ply")).unwrap();
        drop(files);
        assert_eq!(root.path().join("new").exists(), cfg!(not(unix)), "nothing was written");
    }

    #[test]
    fn what_killed_processes_left_unfinished_is_removed_with_the_lock() {
        let folder = tempfile::tempdir().unwrap();
        let [left, other] = [".AbC123.partial", ".notes"].map(|name| folder.path().join(name));
        for file in [&left, &other] {
            std::fs::write(file, b"half").unwrap();
        }
        let lock = OutputLock::of(folder.path()).unwrap();
        assert!(!left.exists() && other.exists());
        let pending = PendingFile::open(&folder.path().join("image")).unwrap();
        drop(lock);
        let _lock = OutputLock::of(folder.path()).unwrap();
        pending.finish(b"whole").unwrap();
    }
}
