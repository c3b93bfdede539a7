use std::path::Path;

use atsplat_scene::{Frame, Picture};

use crate::RoomsError;

pub(super) fn make_folder(folder: &Path) -> Result<(), RoomsError> {
    let io = |source| RoomsError::Io { action: "making", path: folder.to_owned(), source };
    std::fs::create_dir_all(folder).map_err(io)
}

pub(super) fn write_file(path: &Path, bytes: &[u8]) -> Result<(), RoomsError> {
    let io = |source| RoomsError::Io { action: "writing", path: path.to_owned(), source };
    atsplat_files::write_unsynced(path, bytes).map_err(io)
}

/// The encoded picture of a frame that was just rendered.
pub(super) fn encoded(frame: &Frame) -> &[u8] {
    match &frame.picture {
        Picture::Encoded(bytes) => bytes,
        Picture::File(_) | Picture::Made(_) | Picture::Missing(_) | Picture::Absent => &[],
    }
}
