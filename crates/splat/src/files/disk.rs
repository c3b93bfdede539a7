use std::fs::{self, File};
use std::io::{self, BufWriter, Write};
use std::path::Path;
use std::sync::atomic::{AtomicU64, Ordering};

use crate::SplatError;

/// All bytes of a regular file; a pipe or a device could block or never end.
pub(super) fn read(path: &Path) -> Result<Vec<u8>, SplatError> {
    let failed = |source| SplatError::Io { action: "reading", path: path.to_owned(), source };
    let metadata = fs::metadata(path).map_err(failed)?;
    if !metadata.is_file() {
        return Err(failed(io::Error::new(io::ErrorKind::InvalidInput, "not a regular file")));
    }
    fs::read(path).map_err(failed)
}

/// Files that were begun.
static BEGUN: AtomicU64 = AtomicU64::new(0);

/// Writes a file beside its place, then renames it: under its name it is always whole.
pub(super) fn write(
    path: &Path,
    contents: impl FnOnce(&mut BufWriter<File>) -> io::Result<()>,
) -> Result<(), SplatError> {
    let failed = |source| SplatError::Io { action: "writing", path: path.to_owned(), source };
    if path.file_name().is_none() || path.is_dir() {
        return Err(failed(io::ErrorKind::IsADirectory.into()));
    }
    // Short, as the file's own name may be as long as names can be; and never the same for two threads.
    let number = BEGUN.fetch_add(1, Ordering::Relaxed);
    let partial = path.with_file_name(format!(".gaussians.{}.{number}.partial", std::process::id()));
    let outcome = File::create(&partial).and_then(|file| {
        let mut out = BufWriter::new(file);
        contents(&mut out)?;
        out.flush()?;
        out.get_ref().sync_all()?;
        fs::rename(&partial, path)
    });
    outcome.map_err(|source| {
        // What cannot be removed is a hidden file that says what it is; the first error is the one to tell.
        fs::remove_file(&partial).ok();
        failed(source)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_as_long_as_they_can_be() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("n".repeat(255));
        write(&path, |out| out.write_all(b"whole")).unwrap();
        assert_eq!(fs::read(&path).unwrap(), b"whole");
    }

    /// One stops halfway until the other is done: each has a file of its own.
    #[test]
    fn two_threads_write_one_path() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("scene.ply");
        let outer = write(&path, |out| {
            out.write_all(b"first")?;
            write(&path, |out| out.write_all(b"second")).map_err(io::Error::other)
        });
        outer.unwrap();
        assert_eq!(fs::read(&path).unwrap(), b"first");
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1);
    }
}
