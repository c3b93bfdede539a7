//! Allows one writer per folder, or per file. The operating system holds the lock, so a killed writer leaves none behind.

use std::fmt;
use std::fs::{self, File, TryLockError};
use std::io::{self, Read as _, Seek as _, Write as _};
use std::path::{Path, PathBuf};
use std::time::Duration;

use serde::{Deserialize, Serialize};
use thiserror::Error;

use crate::{FileError, date, unix_seconds, write_unsynced};

/// The locked file. It stays behind, empty: removing it would let two writers lock two different files of that name.
const LOCK: &str = "run.lock";
/// Describes the lock's holder; a separate file, since a locked file is not readable on every system.
const HOLDER: &str = "run.json";

/// Exclusive right to write to a folder, until dropped.
#[derive(Debug)]
pub struct FolderLock {
    holder: PathBuf,
    _file: File,
}

/// Exclusive right to write a file, and what belongs to it, until dropped: for files of several writers in one folder. A file next
/// to it, with `.lock` after its name, is locked and describes the holder.
#[derive(Debug)]
pub struct FileLock {
    path: PathBuf,
    _file: File,
}

/// Why a folder or a file cannot be locked.
#[derive(Debug, Error)]
pub enum LockError {
    /// A file operation failed.
    #[error(transparent)]
    Io(#[from] FileError),
    /// Another writer has the lock.
    #[error("{} is being written by {by}", folder.display())]
    InUse {
        /// The folder or the file.
        folder: PathBuf,
        /// Which process, on which machine, since when.
        by: String,
    },
}

/// The process that writes to a folder.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
struct Holder {
    pid: u32,
    host: String,
    /// Seconds since 1970.
    since: u64,
}

impl FolderLock {
    /// The files of a lock in its folder: one that stays behind, and one that is there while the folder is locked.
    pub const FILES: [&str; 2] = [LOCK, HOLDER];

    /// Whether a folder was locked at any time.
    pub fn was_taken(folder: &Path) -> bool {
        folder.join(LOCK).is_file()
    }

    /// A file that a lock of the folder would replace, although no lock wrote it.
    pub fn would_replace(folder: &Path) -> Option<PathBuf> {
        let holder = folder.join(HOLDER);
        let is_of_lock = match fs::read(&holder) {
            Ok(bytes) => serde_json::from_slice::<Holder>(&bytes).is_ok(),
            Err(error) => error.kind() == io::ErrorKind::NotFound,
        };
        (!is_of_lock).then_some(holder)
    }

    /// Removes what a lock left behind in a folder that nothing was written to; a lock that stays is locked again by the next writer.
    pub fn remove_from(folder: &Path) {
        fs::remove_file(folder.join(LOCK)).ok();
    }

    /// Locks a folder, creating it if needed.
    ///
    /// # Errors
    /// [`LockError::InUse`] if another writer has the lock, [`LockError::Io`].
    pub fn of(folder: &Path) -> Result<Self, LockError> {
        let path = folder.join(LOCK);
        fs::create_dir_all(folder).map_err(during("creating a folder", folder))?;
        let file = File::options().create(true).truncate(false).write(true).open(&path);
        let file = file.map_err(during("opening the lock of a folder", &path))?;
        let holder = folder.join(HOLDER);
        match file.try_lock() {
            Ok(()) => {}
            Err(TryLockError::WouldBlock) => return Err(in_use(folder, &holder)),
            Err(TryLockError::Error(source)) => return Err(during("locking a folder", &path)(source)),
        }
        let json = serde_json::to_vec(&Holder::current()).map_err(io::Error::from);
        json.and_then(|json| write_unsynced(&holder, &json)).map_err(during("locking a folder", &holder))?;
        Ok(Self { holder, _file: file })
    }
}

impl Drop for FolderLock {
    fn drop(&mut self) {
        // A file that stays behind is overwritten by the next writer and not read before.
        fs::remove_file(&self.holder).ok();
    }
}

impl FileLock {
    /// Locks a file in a folder that is there; the file itself may be missing.
    ///
    /// # Errors
    /// [`LockError::InUse`] if another writer has the lock; [`LockError::Io`], also for a file in the lock's place that no lock
    /// wrote.
    pub fn of(target: &Path) -> Result<Self, LockError> {
        let path = target.with_added_extension("lock");
        loop {
            let file = File::options().create(true).truncate(false).read(true).write(true).open(&path);
            let mut file = file.map_err(during("opening the lock of a file", &path))?;
            match file.try_lock() {
                Ok(()) => {}
                Err(TryLockError::WouldBlock) => return Err(in_use(target, &path)),
                Err(TryLockError::Error(source)) => return Err(during("locking a file", &path)(source)),
            }
            if is_at(&file, &path) {
                describe(&mut file).map_err(during("locking a file", &path))?;
                return Ok(Self { path, _file: file });
            }
        }
    }
}

impl Drop for FileLock {
    fn drop(&mut self) {
        // While it is locked: a process that has opened it meanwhile finds that it is gone. Elsewhere it stays behind.
        if cfg!(unix) {
            fs::remove_file(&self.path).ok();
        }
    }
}

/// Whether an open file is still the one at its path: the last holder may have removed it before it was locked.
#[cfg(unix)]
fn is_at(file: &File, path: &Path) -> bool {
    use std::os::unix::fs::MetadataExt as _;
    let place = |metadata: fs::Metadata| (metadata.dev(), metadata.ino());
    file.metadata().map(place).ok().is_some_and(|opened| fs::metadata(path).is_ok_and(|found| place(found) == opened))
}

#[cfg(not(unix))]
fn is_at(_: &File, _: &Path) -> bool {
    true
}

/// Writes the holder into the locked file, in place of an earlier one.
fn describe(file: &mut File) -> io::Result<()> {
    let mut before = Vec::new();
    file.read_to_end(&mut before)?;
    if !before.is_empty() && serde_json::from_slice::<Holder>(&before).is_err() {
        return Err(io::Error::new(io::ErrorKind::AlreadyExists, "expected a lock, found a file of another kind"));
    }
    file.set_len(0)?;
    file.rewind()?;
    file.write_all(&serde_json::to_vec(&Holder::current())?)
}

impl Holder {
    fn current() -> Self {
        Self { pid: std::process::id(), host: host(), since: unix_seconds() }
    }
}

impl fmt::Display for Holder {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { pid, host, since } = self;
        let (hours, minutes, seconds) = (since / 3600 % 24, since / 60 % 60, since % 60);
        let date = date(*since);
        write!(f, "process {pid} on {host}, since {date} {hours:02}:{minutes:02}:{seconds:02} UTC")
    }
}

/// A description of this process for messages about folders that it writes: its number, its machine and the time.
pub fn this_process() -> String {
    Holder::current().to_string()
}

fn during(action: &'static str, path: &Path) -> impl FnOnce(io::Error) -> LockError {
    FileError::during(action, path)
}

/// The error for a locked folder or file. Waits briefly for the holder's description: the lock may be a moment old.
fn in_use(folder: &Path, holder: &Path) -> LockError {
    const INTERVAL: Duration = Duration::from_millis(20);
    let read = || serde_json::from_slice::<Holder>(&fs::read(holder).ok()?).ok();
    let found = (0..10).find_map(|_| {
        std::thread::sleep(INTERVAL);
        read()
    });
    let by = found.map_or_else(|| "an unidentified process".to_owned(), |holder| holder.to_string());
    LockError::InUse { folder: folder.to_owned(), by }
}

/// The machine's name, if known.
fn host() -> String {
    let kernel = || fs::read_to_string("/proc/sys/kernel/hostname").ok();
    let variable = || std::env::var("COMPUTERNAME").or_else(|_| std::env::var("HOSTNAME")).ok();
    let name = kernel().or_else(variable).map(|name| name.trim().to_owned()).filter(|name| !name.is_empty());
    name.unwrap_or_else(|| "an unknown machine".to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The second after 2023-11-14 22:13:19 UTC is the 1 700 000 000th since 1970.
    #[test]
    fn a_locked_folder_says_by_whom_and_since_when() {
        let folder = tempfile::tempdir().unwrap();
        let lock = FolderLock::of(folder.path()).unwrap();
        let holder = Holder { pid: 71, host: "there".to_owned(), since: 1_700_000_000 };
        fs::write(folder.path().join(HOLDER), serde_json::to_vec(&holder).unwrap()).unwrap();
        let Err(LockError::InUse { by, .. }) = FolderLock::of(folder.path()) else { panic!("locked twice") };
        assert_eq!(by, "process 71 on there, since 2023-11-14 22:13:20 UTC");
        drop(lock);
        assert!(FolderLock::of(folder.path()).is_ok(), "free again");
    }

    #[test]
    fn a_locked_file_says_by_whom_and_leaves_nothing() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("scene.ply");
        let lock = FileLock::of(&file).unwrap();
        let Err(LockError::InUse { folder: locked, by }) = FileLock::of(&file) else { panic!("locked twice") };
        assert!(locked == file && by.contains(&format!("process {} on ", std::process::id())), "{by}");
        let other = FileLock::of(&folder.path().join("other.ply")).unwrap();
        drop((lock, other));
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), if cfg!(unix) { 0 } else { 2 });
        // As a writer that was killed leaves it.
        let left = folder.path().join("scene.ply.lock");
        fs::write(&left, serde_json::to_vec(&Holder { pid: 71, host: String::new(), since: 1 }).unwrap()).unwrap();
        drop(FileLock::of(&file).unwrap());
        fs::write(&left, "of the user").unwrap();
        let error = FileLock::of(&file).unwrap_err().to_string();
        assert!(
            error.contains("expected a lock, found a file of another kind") && error.contains("scene.ply.lock"),
            "{error}"
        );
        assert_eq!(fs::read(&left).unwrap(), b"of the user");
    }

    /// A process that waits between opening and locking must not lock a file that is gone.
    #[test]
    fn one_of_many_has_the_lock_of_a_file() {
        use std::sync::atomic::{AtomicBool, Ordering};
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("scene.ply");
        let held = AtomicBool::new(false);
        std::thread::scope(|scope| {
            for _ in 0..4 {
                scope.spawn(|| {
                    for _ in 0..200 {
                        // Without the wait for the holder's description.
                        let path = file.with_added_extension("lock");
                        let is_free = File::open(&path).is_ok_and(|open| open.try_lock().is_ok()) || !path.exists();
                        let Some(lock) = is_free.then(|| FileLock::of(&file).ok()).flatten() else { continue };
                        assert!(!held.swap(true, Ordering::SeqCst), "two holders");
                        std::thread::yield_now();
                        held.store(false, Ordering::SeqCst);
                        drop(lock);
                    }
                });
            }
        });
    }
}
