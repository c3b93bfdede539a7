use std::fs::File;
use std::io::{self, BufWriter, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard};

use tempfile::{Builder, NamedTempFile, TempPath};

/// Extension of files that are not complete yet; one that is found later was left by a process that was killed.
pub const PARTIAL: &str = "partial";

/// Writes `bytes` to `path`, replacing what is there, and waits until the disk has them.
///
/// # Errors
/// The operating system's; whatever stood under `path` is then unchanged.
pub fn write(path: &Path, bytes: &[u8]) -> io::Result<()> {
    write_with(path, |out| out.write_all(bytes))
}

/// As [`write`](fn@write), with contents that `fill` writes piece by piece.
///
/// # Errors
/// The operating system's and those of `fill`.
pub fn write_with(path: &Path, fill: impl FnOnce(&mut Writer) -> io::Result<()>) -> io::Result<()> {
    let file = AtomicFile::create(path)?;
    fill(&mut file.writer())?;
    file.commit().map(drop)
}

/// As [`write`](fn@write) without waiting for the disk, for what is cheap to make again after a power failure.
///
/// # Errors
/// The operating system's.
pub fn write_unsynced(path: &Path, bytes: &[u8]) -> io::Result<()> {
    let file = AtomicFile::create(path)?;
    file.writer().write_all(bytes)?;
    file.rename(false).map(drop)
}

/// A file that appears under its name only when it is complete: written beside it, synchronised with the disk, renamed.
/// Dropped before that, it leaves nothing behind.
#[derive(Debug)]
pub struct AtomicFile {
    temporary: TempPath,
    target: PathBuf,
    writer: Writer,
}

/// Writes into an [`AtomicFile`]. Clones share one position, for encoders that keep their writer to themselves.
#[derive(Clone, Debug)]
pub struct Writer(Arc<Mutex<BufWriter<File>>>);

impl AtomicFile {
    /// Opens the temporary file, so that a path that cannot be written is an error before long work starts.
    ///
    /// # Errors
    /// [`io::ErrorKind::IsADirectory`] for a folder, and the operating system's.
    pub fn create(target: &Path) -> io::Result<Self> {
        if target.file_name().is_none() || target.is_dir() {
            return Err(io::ErrorKind::IsADirectory.into());
        }
        let folder = target.parent().filter(|parent| !parent.as_os_str().is_empty()).unwrap_or(Path::new("."));
        // The name does not grow with the target's, which may be as long as names can be.
        let suffix = format!(".{PARTIAL}");
        let mut builder = Builder::new();
        builder.prefix(".").suffix(&suffix);
        let (file, temporary) = readable(&mut builder).tempfile_in(folder).map(NamedTempFile::into_parts)?;
        let writer = Writer(Arc::new(Mutex::new(BufWriter::new(file))));
        Ok(Self { temporary, target: target.to_owned(), writer })
    }

    /// Where the file will appear.
    pub fn target(&self) -> &Path {
        &self.target
    }

    /// Something to write with.
    pub fn writer(&self) -> Writer {
        self.writer.clone()
    }

    /// Puts the file in its place, over one that may be there; its size in bytes.
    ///
    /// # Errors
    /// The operating system's; what was in the place stays there.
    pub fn commit(self) -> io::Result<u64> {
        self.rename(true)
    }

    fn rename(self, synchronised: bool) -> io::Result<u64> {
        let bytes = self.writer.finish(synchronised)?;
        self.temporary.persist(&self.target).map_err(|error| error.error)?;
        if synchronised {
            synchronise_folder(&self.target);
        }
        Ok(bytes)
    }
}

/// Temporary files are private to their owner by default; results are as readable as any new file.
#[cfg(unix)]
fn readable<'b, 'n>(builder: &'b mut Builder<'n, 'n>) -> &'b mut Builder<'n, 'n> {
    use std::os::unix::fs::PermissionsExt as _;
    builder.permissions(std::fs::Permissions::from_mode(0o666))
}

#[cfg(not(unix))]
fn readable<'b, 'n>(builder: &'b mut Builder<'n, 'n>) -> &'b mut Builder<'n, 'n> {
    builder
}

/// Makes the rename itself last. Not every system lets a folder be opened; where it does not, there is nothing to do.
fn synchronise_folder(path: &Path) {
    if let Some(folder) = path.parent().and_then(|folder| File::open(folder).ok()) {
        folder.sync_all().ok();
    }
}

impl Writer {
    fn lock(&self) -> io::Result<MutexGuard<'_, BufWriter<File>>> {
        self.0.lock().map_err(|poisoned| io::Error::other(poisoned.to_string()))
    }

    fn finish(&self, synchronised: bool) -> io::Result<u64> {
        let mut file = self.lock()?;
        file.flush()?;
        if synchronised {
            file.get_ref().sync_all()?;
        }
        Ok(file.get_ref().metadata()?.len())
    }
}

impl Write for Writer {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.lock()?.write(bytes)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.lock()?.flush()
    }
}

impl Seek for Writer {
    fn seek(&mut self, position: SeekFrom) -> io::Result<u64> {
        self.lock()?.seek(position)
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
    fn a_file_appears_when_it_is_complete() {
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
    fn a_failure_leaves_the_old_file_and_nothing_else() {
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
    fn a_folder_is_no_file() {
        let folder = tempfile::tempdir().unwrap();
        assert_eq!(write(folder.path(), b"").unwrap_err().kind(), io::ErrorKind::IsADirectory);
        assert_eq!(write(Path::new(".."), b"").unwrap_err().kind(), io::ErrorKind::IsADirectory);
        assert!(AtomicFile::create(&folder.path().join("absent/file")).is_err());
    }

    /// Names are drawn, so that nobody can place a link where they will be; and the link at the target is replaced, not
    /// followed.
    #[cfg(unix)]
    #[test]
    fn links_are_replaced_and_others_may_read() {
        use std::os::unix::fs::PermissionsExt as _;
        let folder = tempfile::tempdir().unwrap();
        let (precious, path) = (folder.path().join("precious"), folder.path().join("file"));
        fs::write(&precious, "precious").unwrap();
        std::os::unix::fs::symlink(&precious, &path).unwrap();
        write_unsynced(&path, b"new").unwrap();
        assert_eq!(fs::read(&precious).unwrap(), b"precious");
        assert_eq!(fs::read(&path).unwrap(), b"new");
        let mode = |path: &Path| fs::metadata(path).unwrap().permissions().mode();
        assert_eq!(mode(&path), mode(&precious), "as a file that is written without a temporary one");
    }
}
