//! Checks of picture files that cost less than decoding them.

use std::fs::File;
use std::io::{Read as _, Seek as _, SeekFrom};
use std::path::Path;

use crate::cut_short::{JPEG_END, PNG_END, cut_short};
use crate::files::read_file;
use crate::{Picture, SceneError};

/// Whether there is nothing in the file; `false` if that cannot be found out.
pub(super) fn is_empty_file(path: &Path) -> bool {
    std::fs::metadata(path).is_ok_and(|metadata| metadata.is_file() && metadata.len() == 0)
}

/// What is wrong with a picture whose end is missing.
///
/// # Errors
/// A file that cannot be read, although its header could.
pub(super) fn picture_cut_short(picture: &Picture) -> Result<Option<String>, SceneError> {
    match picture {
        Picture::Encoded(bytes) => Ok(cut_short(bytes)),
        // Nearly all end with their format's last bytes. Others may have more behind them, so they are read.
        Picture::File(path) if !ends_like_a_picture(path) => Ok(cut_short(&read_file("reading a picture", path)?)),
        _ => Ok(None),
    }
}

fn ends_like_a_picture(path: &Path) -> bool {
    let end = || {
        let mut file = File::open(path)?;
        let length = file.metadata()?.len();
        file.seek(SeekFrom::Start(length.saturating_sub(PNG_END.len() as u64)))?;
        let mut end = Vec::new();
        file.read_to_end(&mut end).map(|_length| end)
    };
    end().is_ok_and(|end: Vec<u8>| end == PNG_END || end.ends_with(&JPEG_END))
}
