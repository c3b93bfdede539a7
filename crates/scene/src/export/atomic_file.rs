use std::ffi::OsString;
use std::fs::{self, File};
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard};

use super::ExportError;

/// A file that appears under its name only when it is complete: written beside it, synchronised, renamed.
/// Dropped before that, it leaves nothing behind.
#[derive(Debug)]
pub(super) struct AtomicFile {
    target: PathBuf,
    partial: PathBuf,
    handle: Handle,
    committed: bool,
}

/// Writes into an [`AtomicFile`]; encoders that keep their writer to themselves get a clone.
#[derive(Clone, Debug)]
pub(super) struct Handle(Arc<Mutex<BufWriter<File>>>);

impl AtomicFile {
    /// Opens the file to write into, so that a wrong path is told before long work starts.
    pub(super) fn create(target: &Path) -> Result<Self, ExportError> {
        const OPENING: &str = "opening an output file";
        let name = target.file_name().filter(|_| !target.is_dir());
        let name = name.ok_or_else(|| ExportError::io(OPENING, target)(io::ErrorKind::IsADirectory.into()))?;
        let mut partial = OsString::from(".");
        partial.push(name);
        partial.push(format!(".{}.partial", std::process::id()));
        let partial = target.with_file_name(partial);
        let file = File::create(&partial).map_err(ExportError::io(OPENING, target))?;
        let handle = Handle(Arc::new(Mutex::new(BufWriter::new(file))));
        Ok(Self { target: target.to_owned(), partial, handle, committed: false })
    }

    /// Where the file will appear.
    pub(super) fn target(&self) -> &Path {
        &self.target
    }

    /// Something to write with.
    pub(super) fn handle(&self) -> Handle {
        self.handle.clone()
    }

    /// Puts the file in its place, over one that may be there; its size.
    pub(super) fn commit(mut self) -> Result<u64, ExportError> {
        let outcome = self.synchronise().and_then(|bytes| fs::rename(&self.partial, &self.target).map(|()| bytes));
        self.committed = outcome.is_ok();
        outcome.map_err(ExportError::io("finishing an output file", &self.target))
    }

    fn synchronise(&self) -> io::Result<u64> {
        let mut file = self.handle.lock()?;
        file.flush()?;
        file.get_ref().sync_all()?;
        Ok(file.get_ref().metadata()?.len())
    }
}

impl Drop for AtomicFile {
    fn drop(&mut self) {
        if !self.committed {
            // What cannot be removed is a hidden file that says what it is; there is nobody left to tell.
            fs::remove_file(&self.partial).ok();
        }
    }
}

impl Handle {
    fn lock(&self) -> io::Result<MutexGuard<'_, BufWriter<File>>> {
        self.0.lock().map_err(|poisoned| io::Error::other(poisoned.to_string()))
    }
}

impl Write for Handle {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.lock()?.write(bytes)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.lock()?.flush()
    }
}
