use std::ffi::OsString;
use std::fs::{self, File};
use std::io::{self, BufWriter, Write};
use std::path::Path;

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

/// Writes a file beside its place, then renames it: under its name it is always whole.
pub(super) fn write(
    path: &Path,
    contents: impl FnOnce(&mut BufWriter<File>) -> io::Result<()>,
) -> Result<(), SplatError> {
    let failed = |source| SplatError::Io { action: "writing", path: path.to_owned(), source };
    let name = path.file_name().filter(|_| !path.is_dir());
    let name = name.ok_or_else(|| failed(io::ErrorKind::IsADirectory.into()))?;
    let mut partial = OsString::from(".");
    partial.push(name);
    partial.push(format!(".{}.partial", std::process::id()));
    let partial = path.with_file_name(partial);
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
