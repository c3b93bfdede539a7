//! The folder for the files of a method's trials.

use std::fs::{self, File};
use std::io;
use std::path::Path;

use tempfile::{Builder, TempDir};

const PREFIX: &str = "atsplat-method-";
/// A file in the folder that is locked as long as its process lives, however that ends.
const LOCK: &str = "atsplat-method.lock";
const UNLOCKED: &str = "atsplat-method.unlocked";

/// A temporary folder, removed when this is dropped. Nothing is dropped in a process that a signal ends: its folder is
/// removed when another one is created.
#[derive(Debug)]
pub(super) struct Scratch {
    /// Before the folder, since some systems remove no open file.
    _lock: File,
    folder: TempDir,
}

impl Scratch {
    pub(super) fn new_in(parent: &Path) -> io::Result<Self> {
        remove_abandoned(parent);
        let folder = Builder::new().prefix(PREFIX).tempdir_in(parent)?;
        // Under another name until it is locked: without its name, the folder is left alone.
        let (unlocked, locked) = (folder.path().join(UNLOCKED), folder.path().join(LOCK));
        let lock = File::create_new(&unlocked)?;
        // Where files cannot be locked, no folder is taken for an abandoned one.
        lock.lock().ok();
        fs::rename(&unlocked, &locked)?;
        Ok(Self { _lock: lock, folder })
    }

    pub(super) fn path(&self) -> &Path {
        self.folder.path()
    }
}

/// Removes folders whose process has ended, if this user may.
fn remove_abandoned(parent: &Path) {
    let folders = fs::read_dir(parent).into_iter().flatten().flatten().map(|entry| entry.path());
    for folder in folders.filter(|folder| atsplat_files::name_of(folder).starts_with(PREFIX)) {
        let lock = folder.join(LOCK);
        // Without the file, the folder is being created, or another program's. A pipe could block.
        if fs::symlink_metadata(&lock).is_ok_and(|metadata| metadata.is_file())
            && let Ok(lock) = File::options().write(true).open(&lock)
            && lock.try_lock().is_ok()
        {
            fs::remove_dir_all(&folder).ok();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_folder_whose_process_has_ended_is_removed_when_another_is_created() {
        let parent = tempfile::tempdir().unwrap();
        let left = |name: &str, file: &str| {
            let folder = parent.path().join(name);
            fs::create_dir_all(folder.join("trial-0")).unwrap();
            fs::write(folder.join(file), "").unwrap();
            folder
        };
        let killed = left("atsplat-method-x", LOCK);
        let others = [left("atsplat-method-y", "notes"), left("project", LOCK)];
        let [first, second] = [(); 2].map(|()| Scratch::new_in(parent.path()).unwrap());
        assert!(!killed.exists() && others.iter().all(|folder| folder.is_dir()), "only what is known to be abandoned");
        let used = [first.path(), second.path()].map(Path::to_owned);
        assert!(used.iter().all(|folder| folder.is_dir()), "the first is in use");
        drop((first, second));
        assert!(!used.iter().any(|folder| folder.exists()));
    }
}
