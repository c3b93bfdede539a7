use std::fs;
use std::io;
use std::path::Path;

use atsplat_files::Writer;

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

/// Writes a file that appears under its name when it is complete.
pub(super) fn write(path: &Path, contents: impl FnOnce(&mut Writer) -> io::Result<()>) -> Result<(), SplatError> {
    let failed = |source| SplatError::Io { action: "writing", path: path.to_owned(), source };
    atsplat_files::write_with(path, contents).map_err(failed)
}
