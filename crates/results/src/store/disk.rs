use std::path::{Path, PathBuf};

use crate::ResultsError;

/// Writes a file atomically and durably: readers, also after a crash, see the old or the new content.
pub(crate) fn write(path: &Path, bytes: &[u8]) -> Result<(), ResultsError> {
    atsplat_files::write(path, bytes).map_err(ResultsError::io("writing results", path))
}

/// Like [`write()`] without waiting for the disk: for images, which can be recreated after a power failure.
pub(crate) fn write_unsynced(path: &Path, bytes: &[u8]) -> Result<(), ResultsError> {
    atsplat_files::write_unsynced(path, bytes).map_err(ResultsError::io("writing results", path))
}

/// Files of a folder, sorted by name; none if the folder does not exist.
pub(crate) fn files(folder: &Path) -> Result<Vec<PathBuf>, ResultsError> {
    atsplat_files::entries_if_exists(folder).map_err(ResultsError::io("reading results", folder))
}

/// Bytes of a file; `None` if it does not exist.
pub(super) fn read(path: &Path) -> Result<Option<Vec<u8>>, ResultsError> {
    atsplat_files::read_if_exists(path).map_err(ResultsError::io("reading results", path))
}

/// Removes a file if it exists.
pub(super) fn remove(path: &Path) -> Result<(), ResultsError> {
    atsplat_files::remove_if_exists(path).map_err(ResultsError::io("removing results", path))
}
