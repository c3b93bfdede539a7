//! Allows one writer per folder, or per file. The operating system holds the lock, so a killed writer leaves none behind.

use std::fmt;
use std::fs::{self, File, TryLockError};
use std::io::{self, Read as _, Seek as _, Write as _};
use std::path::{Path, PathBuf};
use std::time::Duration;

use serde::{Deserialize, Serialize};
use thiserror::Error;

use crate::{FileError, create_folder, date, read_if_exists, unix_seconds, write_unsynced};

/// The locked file. It stays behind, empty, in a folder that something was written to.
const LOCK: &str = "run.lock";
/// Describes the lock's holder; a separate file, since a locked file is not readable on every system.
const HOLDER: &str = "run.json";

/// Exclusive right to write to a folder, until dropped.
#[derive(Debug)]
pub struct FolderLock {
    path: PathBuf,
    holder: PathBuf,
    leaves_nothing: bool,
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

    /// The folder.
    #[expect(clippy::expect_used, reason = "the locked file is in it")]
    pub fn folder(&self) -> &Path {
        self.path.parent().expect("a file in the folder")
    }

    /// Whether a folder was locked at any time.
    pub fn was_taken(folder: &Path) -> bool {
        folder.join(LOCK).is_file()
    }

    /// Locks a folder, creating it if needed.
    ///
    /// # Errors
    /// [`LockError::InUse`] if another writer has the lock; [`LockError::Io`], also for a `run.json` that no lock wrote.
    pub fn of(folder: &Path) -> Result<Self, LockError> {
        let (path, holder) = (folder.join(LOCK), folder.join(HOLDER));
        create_folder(folder).map_err(during("creating a folder", folder))?;
        // A lock writes it whole, so that it is never half a description. Before anything is created in a folder of the user.
        require_holder(&holder).map_err(during("locking a folder", &holder))?;
        let file = locked(&path)?.ok_or_else(|| in_use(folder, &holder))?;
        let json = serde_json::to_vec(&Holder::current()).map_err(io::Error::from);
        json.and_then(|json| write_unsynced(&holder, &json)).map_err(during("locking a folder", &holder))?;
        Ok(Self { path, holder, leaves_nothing: false, _file: file })
    }

    /// Unlocks a folder that nothing was written to, and leaves no file in it where that is possible.
    pub fn remove(mut self) {
        self.leaves_nothing = cfg!(unix);
    }
}

impl Drop for FolderLock {
    fn drop(&mut self) {
        // A file that stays behind is overwritten by the next writer and not read before.
        fs::remove_file(&self.holder).ok();
        // Last, and while it is locked: a process that has opened it meanwhile finds that it is gone.
        if self.leaves_nothing {
            fs::remove_file(&self.path).ok();
        }
    }
}

/// An error for a file in the place of a holder's description that no lock wrote.
fn require_holder(path: &Path) -> io::Result<()> {
    read_if_exists(path)?.map_or(Ok(()), |bytes| require_description(&bytes))
}

fn require_description(bytes: &[u8]) -> io::Result<()> {
    if serde_json::from_slice::<Holder>(bytes).is_ok() {
        return Ok(());
    }
    let found = "expected a lock, found a file of another kind: move it away, or choose another folder";
    Err(io::Error::new(io::ErrorKind::AlreadyExists, found))
}

/// The file at a path, created if it is missing, and locked; `None` if another writer has the lock.
fn locked(path: &Path) -> Result<Option<File>, LockError> {
    loop {
        let file = File::options().create(true).truncate(false).read(true).write(true).open(path);
        let file = file.map_err(during("opening a lock", path))?;
        match file.try_lock() {
            Ok(()) if is_at(&file, path) => return Ok(Some(file)),
            // The last holder has removed it after it was opened.
            Ok(()) => {}
            Err(TryLockError::WouldBlock) => return Ok(None),
            Err(TryLockError::Error(source)) => return Err(during("locking", path)(source)),
        }
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
        let mut file = locked(&path)?.ok_or_else(|| in_use(target, &path))?;
        describe(&mut file).map_err(during("locking a file", &path))?;
        Ok(Self { path, _file: file })
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
    if !before.is_empty() {
        require_description(&before)?;
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

    #[test]
    fn a_file_of_the_user_is_neither_replaced_nor_removed() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join(HOLDER);
        fs::write(&file, br#"{ "pid": 7 }"#).unwrap();
        let error = FolderLock::of(folder.path()).unwrap_err().to_string();
        assert!(error.contains("found a file of another kind") && error.contains(HOLDER), "{error}");
        assert_eq!(fs::read(&file).unwrap(), br#"{ "pid": 7 }"#);
        assert!(!FolderLock::was_taken(folder.path()), "nothing was written");
        fs::write(&file, br#"{ "pid": 7, "host": "a", "since": 1 }"#).unwrap();
        drop(FolderLock::of(folder.path()).unwrap());
        assert!(!file.exists(), "left by a process that was killed");
    }

    /// Whoever has opened the lock of a folder that is given back must not lock it, next to a file that is new.
    #[test]
    fn a_lock_that_was_removed_cannot_be_taken() {
        let folder = tempfile::tempdir().unwrap();
        let lock = FolderLock::of(folder.path()).unwrap();
        let opened = File::open(folder.path().join(LOCK)).unwrap();
        lock.remove();
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), usize::from(!cfg!(unix)));
        assert_eq!(is_at(&opened, &folder.path().join(LOCK)), cfg!(not(unix)));
    }

    #[test]
    fn one_of_many_has_the_lock_of_a_file() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("scene.ply");
        one_of_many_has(&file.with_added_extension("lock"), || FileLock::of(&file), drop);
    }

    #[test]
    fn one_of_many_has_the_lock_of_a_folder() {
        let folder = tempfile::tempdir().unwrap();
        one_of_many_has(&folder.path().join(LOCK), || FolderLock::of(folder.path()), FolderLock::remove);
    }

    /// A process that waits between opening and locking must not lock a file that is gone.
    fn one_of_many_has<T>(path: &Path, lock: impl Fn() -> Result<T, LockError> + Sync, unlock: impl Fn(T) + Sync) {
        use std::sync::atomic::{AtomicBool, Ordering};
        let held = AtomicBool::new(false);
        std::thread::scope(|scope| {
            for _ in 0..4 {
                scope.spawn(|| {
                    for _ in 0..200 {
                        // Without the wait for the holder's description.
                        let is_free = File::open(path).is_ok_and(|open| open.try_lock().is_ok()) || !path.exists();
                        let Some(lock) = is_free.then(|| lock().ok()).flatten() else { continue };
                        assert!(!held.swap(true, Ordering::SeqCst), "two holders");
                        std::thread::yield_now();
                        held.store(false, Ordering::SeqCst);
                        unlock(lock);
                    }
                });
            }
        });
    }
}
