use std::fs::{self, File};
use std::io::{self, Write as _};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};

use crate::EvalError;

/// Ends the names of files that are not whole yet.
pub(super) const UNFINISHED: &str = "tmp";

/// Writes a file so that whoever reads it, after a crash too, sees all of it or what was there before: into another file
/// beside it, which is synchronised with the disk and then renamed.
pub(crate) fn write(path: &Path, bytes: &[u8]) -> Result<(), EvalError> {
    replace(path, bytes, true)?;
    synchronise_folder(path);
    Ok(())
}

/// The same without waiting for the disk: a picture that a power failure costs is made again by who wants it.
pub(crate) fn write_lightly(path: &Path, bytes: &[u8]) -> Result<(), EvalError> {
    replace(path, bytes, false)
}

fn replace(path: &Path, bytes: &[u8], synchronised: bool) -> Result<(), EvalError> {
    static COUNT: AtomicU64 = AtomicU64::new(0);
    let number = COUNT.fetch_add(1, Ordering::Relaxed);
    let mut name = path.as_os_str().to_owned();
    name.push(format!(".{}-{number}.{UNFINISHED}", std::process::id()));
    let unfinished = PathBuf::from(name);
    let written = fill(&unfinished, bytes, synchronised).and_then(|()| fs::rename(&unfinished, path));
    written.map_err(|source| {
        fs::remove_file(&unfinished).ok();
        EvalError::Io { action: "writing results", path: path.to_owned(), source }
    })
}

fn fill(path: &Path, bytes: &[u8], synchronised: bool) -> io::Result<()> {
    let mut file = File::create_new(path)?;
    file.write_all(bytes)?;
    if synchronised { file.sync_all() } else { Ok(()) }
}

/// Makes the rename itself last. Not every system lets a folder be opened; where it does not, there is nothing to do.
fn synchronise_folder(path: &Path) {
    if let Some(folder) = path.parent().and_then(|folder| File::open(folder).ok()) {
        folder.sync_all().ok();
    }
}

/// Files of a folder by name, sorted; none where the folder does not exist.
pub(super) fn files(folder: &Path) -> Result<Vec<PathBuf>, EvalError> {
    let entries = match fs::read_dir(folder) {
        Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(Vec::new()),
        outcome => outcome.map_err(EvalError::io("reading results", folder))?,
    };
    let mut paths = Vec::new();
    for entry in entries {
        paths.push(entry.map_err(EvalError::io("reading results", folder))?.path());
    }
    paths.sort();
    Ok(paths)
}

/// Bytes of a file; `None` where it does not exist.
pub(super) fn read(path: &Path) -> Result<Option<Vec<u8>>, EvalError> {
    match fs::read(path) {
        Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(None),
        outcome => Ok(Some(outcome.map_err(EvalError::io("reading results", path))?)),
    }
}

/// Removes a file; one that does not exist is gone already.
pub(super) fn remove(path: &Path) -> Result<(), EvalError> {
    match fs::remove_file(path) {
        Err(error) if error.kind() != io::ErrorKind::NotFound => Err(EvalError::io("removing results", path)(error)),
        _ => Ok(()),
    }
}
