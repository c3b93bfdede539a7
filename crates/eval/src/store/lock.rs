//! One writer for a store. The operating system holds the lock, so that a writer that was killed holds none.

use std::fs::{self, File, TryLockError};
use std::path::{Path, PathBuf};
use std::time::{Duration, SystemTime, UNIX_EPOCH};

use serde::{Deserialize, Serialize};

use super::disk;
use crate::EvalError;

/// What is locked. It stays, empty: to remove it would let two writers lock two files of one name.
const LOCK: &str = "run.lock";
/// Who holds the lock; beside it, since a locked file cannot be read everywhere.
const HOLDER: &str = "run.json";

/// The right to write into a store, until it is dropped.
#[derive(Debug)]
pub(super) struct Lock {
    holder: PathBuf,
    _file: File,
}

/// Who writes into a store.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
struct Holder {
    pid: u32,
    host: String,
    /// Seconds since 1970.
    since: u64,
}

impl Lock {
    /// Locks a store's folder, which is made where needed.
    ///
    /// # Errors
    /// [`EvalError::InUse`] where another writer has it, [`EvalError::Io`].
    pub(super) fn of(folder: &Path) -> Result<Self, EvalError> {
        let path = folder.join(LOCK);
        fs::create_dir_all(folder).map_err(EvalError::io("making a results store", folder))?;
        let file = File::options().create(true).truncate(false).write(true).open(&path);
        let file = file.map_err(EvalError::io("opening a results store", &path))?;
        let holder = folder.join(HOLDER);
        match file.try_lock() {
            Ok(()) => {}
            Err(TryLockError::WouldBlock) => return Err(in_use(folder, &holder)),
            Err(TryLockError::Error(source)) => return Err(EvalError::io("locking a results store", &path)(source)),
        }
        let json = serde_json::to_vec(&Holder::here());
        let json = json.map_err(|error| EvalError::malformed(&holder, "file", "a process that JSON holds", error))?;
        disk::write_unsynced(&holder, &json)?;
        Ok(Self { holder, _file: file })
    }
}

impl Drop for Lock {
    fn drop(&mut self) {
        // What stays behind is overwritten by the next writer and read by nobody before.
        fs::remove_file(&self.holder).ok();
    }
}

impl Holder {
    fn here() -> Self {
        let since = SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |since| since.as_secs());
        Self { pid: std::process::id(), host: host(), since }
    }
}

/// The writer may have locked the store a moment ago, and not have said its name.
fn in_use(folder: &Path, holder: &Path) -> EvalError {
    const PATIENCE: Duration = Duration::from_millis(20);
    let read = || serde_json::from_slice::<Holder>(&disk::read(holder).ok()??).ok();
    let found = (0..10).find_map(|_| {
        std::thread::sleep(PATIENCE);
        read()
    });
    let by = found.map_or_else(
        || "another process, which did not leave its name".to_owned(),
        |Holder { pid, host, since }| {
            let (hours, minutes, seconds) = (since / 3600 % 24, since / 60 % 60, since % 60);
            let date = crate::drift::date(since);
            format!("process {pid} on {host}, since {date} {hours:02}:{minutes:02}:{seconds:02} UTC")
        },
    );
    EvalError::InUse { folder: folder.to_owned(), by }
}

/// The machine's name, as far as it says.
fn host() -> String {
    let kernel = || fs::read_to_string("/proc/sys/kernel/hostname").ok();
    let variable = || std::env::var("COMPUTERNAME").or_else(|_| std::env::var("HOSTNAME")).ok();
    let name = kernel().or_else(variable).map(|name| name.trim().to_owned()).filter(|name| !name.is_empty());
    name.unwrap_or_else(|| "a machine without a name".to_owned())
}
