use std::fs::File;
use std::io::{self, BufWriter, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard};

use tempfile::{Builder, NamedTempFile, TempPath};

/// Extension of incomplete files; a remaining one was left by a process that was killed.
pub const PARTIAL: &str = "partial";

/// Random characters in the name of a temporary file.
const RANDOM: usize = 6;

/// Writes `bytes` to `path`, replacing an existing file, and waits until they are on disk.
///
/// # Errors
/// I/O errors; an existing file is then unchanged.
pub fn write(path: &Path, bytes: &[u8]) -> io::Result<()> {
    AtomicFile::holding(path, bytes)?.commit().map(drop)
}

/// [`write`](fn@write) with contents that `fill` writes incrementally.
///
/// # Errors
/// I/O errors and those of `fill`.
pub fn write_with(path: &Path, fill: impl FnOnce(&mut Writer) -> io::Result<()>) -> io::Result<()> {
    let file = AtomicFile::create(path)?;
    fill(&mut file.writer())?;
    file.commit().map(drop)
}

/// [`write`](fn@write) without waiting for the disk, for files that are cheap to recreate after a power failure.
///
/// # Errors
/// I/O errors.
pub fn write_unsynced(path: &Path, bytes: &[u8]) -> io::Result<()> {
    AtomicFile::holding(path, bytes)?.rename(false).map(drop)
}

/// A file that appears under its name only when it is complete: written to a temporary file in the same folder,
/// synchronised with the disk and renamed. Dropped before that, it leaves nothing.
#[derive(Debug)]
pub struct AtomicFile {
    temporary: TempPath,
    target: PathBuf,
    writer: Writer,
}

/// Writes to an [`AtomicFile`] until that is complete. Clones share one position, for encoders that do not give their writer
/// back.
#[derive(Clone, Debug)]
pub struct Writer(Arc<Mutex<Option<BufWriter<File>>>>);

impl AtomicFile {
    /// Opens the temporary file, so that an unwritable path is an error before long work starts.
    ///
    /// # Errors
    /// [`io::ErrorKind::IsADirectory`] for a folder, and other I/O errors.
    pub fn create(target: &Path) -> io::Result<Self> {
        if target.file_name().is_none() || target.is_dir() {
            return Err(io::ErrorKind::IsADirectory.into());
        }
        let folder = folder_of(target);
        // The name does not depend on the target's, which may have the maximum length.
        let suffix = format!(".{PARTIAL}");
        let mut builder = Builder::new();
        builder.prefix(".").suffix(&suffix).rand_bytes(RANDOM);
        let (file, temporary) = readable(&mut builder).tempfile_in(folder).map(NamedTempFile::into_parts)?;
        // For `remove_abandoned`; not every file system has locks.
        file.try_lock_shared().ok();
        let writer = Writer(Arc::new(Mutex::new(Some(BufWriter::new(file)))));
        Ok(Self { temporary, target: target.to_owned(), writer })
    }

    /// A file with all its contents, which lacks only its name.
    ///
    /// # Errors
    /// As [`Self::create`].
    pub fn holding(target: &Path, bytes: &[u8]) -> io::Result<Self> {
        let file = Self::create(target)?;
        let mut writer = file.writer();
        writer.write_all(bytes)?;
        writer.flush()?;
        Ok(file)
    }

    /// The path of the complete file.
    pub fn target(&self) -> &Path {
        &self.target
    }

    /// A writer to the file.
    pub fn writer(&self) -> Writer {
        self.writer.clone()
    }

    /// Renames the file into place, replacing an existing one, and returns its size in bytes.
    ///
    /// # Errors
    /// I/O errors; an existing file is then unchanged.
    pub fn commit(self) -> io::Result<u64> {
        self.rename(true)
    }

    fn rename(self, synchronised: bool) -> io::Result<u64> {
        let file = self.writer.finish(synchronised)?;
        let bytes = file.metadata()?.len();
        // Locked until it has its name, so that nobody takes it for abandoned; Windows renames no open file.
        let _locked = cfg!(unix).then_some(file);
        self.temporary.persist(&self.target).map_err(|error| error.error)?;
        if synchronised {
            synchronise_folder(&self.target);
        }
        Ok(bytes)
    }
}

/// Removes the temporary files of [`AtomicFile`]s that killed processes left in a folder, but not in those below it. Files of
/// running processes are locked and stay, as do all on file systems without locks. Returns how many were removed.
///
/// # Errors
/// I/O errors of listing the folder and of removing a file.
pub fn remove_abandoned(folder: &Path) -> io::Result<u64> {
    let mut removed = 0;
    for entry in folder.read_dir()? {
        let entry = entry?;
        let is_abandoned = || File::open(entry.path()).is_ok_and(|file| file.try_lock().is_ok());
        if entry.file_name().to_str().is_some_and(is_temporary_name) && entry.file_type()?.is_file() && is_abandoned() {
            std::fs::remove_file(entry.path())?;
            removed += 1;
        }
    }
    Ok(removed)
}

/// Whether an [`AtomicFile`]'s temporary file can have this name: `.AbC123.partial`.
fn is_temporary_name(name: &str) -> bool {
    let random = name.strip_prefix('.').and_then(|name| name.strip_suffix(PARTIAL)?.strip_suffix('.'));
    random.is_some_and(|random| random.len() == RANDOM && random.bytes().all(|byte| byte.is_ascii_alphanumeric()))
}

/// Gives the file the default permissions of new files; temporary files are private to their owner.
#[cfg(unix)]
fn readable<'b, 'n>(builder: &'b mut Builder<'n, 'n>) -> &'b mut Builder<'n, 'n> {
    use std::os::unix::fs::PermissionsExt as _;
    builder.permissions(std::fs::Permissions::from_mode(0o666))
}

#[cfg(not(unix))]
fn readable<'b, 'n>(builder: &'b mut Builder<'n, 'n>) -> &'b mut Builder<'n, 'n> {
    builder
}

/// Makes the rename itself durable, on systems that can open a folder.
fn synchronise_folder(path: &Path) {
    if let Ok(folder) = File::open(folder_of(path)) {
        folder.sync_all().ok();
    }
}

/// The folder of a file; the current one for a bare name.
fn folder_of(file: &Path) -> &Path {
    file.parent().filter(|parent| !parent.as_os_str().is_empty()).unwrap_or(Path::new("."))
}

fn complete() -> io::Error {
    io::Error::other("the file is complete")
}

impl Writer {
    fn lock(&self) -> io::Result<MutexGuard<'_, Option<BufWriter<File>>>> {
        self.0.lock().map_err(|poisoned| io::Error::other(poisoned.to_string()))
    }

    fn with<T>(&self, work: impl FnOnce(&mut BufWriter<File>) -> io::Result<T>) -> io::Result<T> {
        self.lock()?.as_mut().map_or_else(|| Err(complete()), work)
    }

    fn finish(&self, synchronised: bool) -> io::Result<File> {
        let file = self.lock()?.take().ok_or_else(complete)?;
        let file = file.into_inner().map_err(io::IntoInnerError::into_error)?;
        if synchronised {
            file.sync_all()?;
        }
        Ok(file)
    }
}

impl Write for Writer {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.with(|file| file.write(bytes))
    }

    /// Nothing is left to flush in a complete file.
    fn flush(&mut self) -> io::Result<()> {
        self.lock()?.as_mut().map_or(Ok(()), BufWriter::flush)
    }
}

impl Seek for Writer {
    fn seek(&mut self, position: SeekFrom) -> io::Result<u64> {
        self.with(|file| file.seek(position))
    }
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::*;

    fn names(folder: &Path) -> Vec<PathBuf> {
        fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()).collect()
    }

    #[test]
    fn files_appear_when_complete() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("n".repeat(255));
        fs::write(&path, "old").unwrap();
        let file = AtomicFile::create(&path).unwrap();
        let (mut first, mut second) = (file.writer(), file.writer());
        first.write_all(b"one, ").unwrap();
        second.write_all(b"two").unwrap();
        assert_eq!(fs::read(&path).unwrap(), b"old");
        assert_eq!(file.commit().unwrap(), 8);
        assert_eq!(fs::read(&path).unwrap(), b"one, two");
        assert_eq!(names(folder.path()), [path]);
    }

    #[test]
    fn a_failure_leaves_only_the_old_file() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("file");
        write(&path, b"old").unwrap();
        let failed = write_with(&path, |out| {
            out.write_all(b"new")?;
            Err(io::ErrorKind::StorageFull.into())
        });
        assert_eq!(failed.unwrap_err().kind(), io::ErrorKind::StorageFull);
        assert_eq!(fs::read(&path).unwrap(), b"old");
        assert_eq!(names(folder.path()), [path]);
    }

    #[test]
    fn a_complete_file_does_not_grow() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("file");
        let file = AtomicFile::create(&path).unwrap();
        let mut writer = file.writer();
        writer.write_all(b"all").unwrap();
        file.commit().unwrap();
        assert!(writer.write_all(b" and more").is_err() && writer.rewind().is_err());
        assert!(writer.flush().is_ok());
        drop(writer);
        assert_eq!(fs::read(&path).unwrap(), b"all");
    }

    #[test]
    fn a_bare_name_is_in_the_current_folder() {
        let folders = ["a.json", "b/a.json", "/a.json"].map(|path| folder_of(Path::new(path)));
        assert_eq!(folders, [".", "b", "/"].map(Path::new));
    }

    #[test]
    fn folders_and_missing_folders_are_errors() {
        let folder = tempfile::tempdir().unwrap();
        assert_eq!(write(folder.path(), b"").unwrap_err().kind(), io::ErrorKind::IsADirectory);
        assert_eq!(write(Path::new(".."), b"").unwrap_err().kind(), io::ErrorKind::IsADirectory);
        assert!(AtomicFile::create(&folder.path().join("absent/file")).is_err());
    }

    #[test]
    fn only_what_killed_processes_left_is_removed() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        let kept = [".notes.partial", ".AbC123.part", "AbC123.partial", ".AbC-23.partial", "file"];
        for name in kept.into_iter().chain([".AbC123.partial", ".000000.partial"]) {
            fs::write(at(name), "part").unwrap();
        }
        fs::create_dir(at(".folder.partial")).unwrap();
        let running = AtomicFile::create(&at("running")).unwrap();
        assert_eq!(remove_abandoned(folder.path()).unwrap(), 2);
        assert_eq!(names(folder.path()).len(), kept.len() + 2, "the folder and the running one stay");
        running.commit().unwrap();
        assert!(at("running").is_file() && kept.iter().all(|name| at(name).is_file()));
    }

    /// Temporary names are random, so that nobody can place a link there; a link at the target is replaced, not followed.
    #[cfg(unix)]
    #[test]
    fn links_are_replaced_and_permissions_are_the_default() {
        use std::os::unix::fs::PermissionsExt as _;
        let folder = tempfile::tempdir().unwrap();
        let (precious, path) = (folder.path().join("precious"), folder.path().join("file"));
        fs::write(&precious, "precious").unwrap();
        std::os::unix::fs::symlink(&precious, &path).unwrap();
        write_unsynced(&path, b"new").unwrap();
        assert_eq!(fs::read(&precious).unwrap(), b"precious");
        assert_eq!(fs::read(&path).unwrap(), b"new");
        let mode = |path: &Path| fs::metadata(path).unwrap().permissions().mode();
        assert_eq!(mode(&path), mode(&precious), "same permissions as a file written directly");
    }
}
