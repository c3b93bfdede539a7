//! Checks of image files that cost less than decoding them.

use std::collections::BTreeMap;
use std::io::{Read as _, Seek as _, SeekFrom};
use std::path::Path;

use atsplat_camera::ImageSize;
use atsplat_pixels::JPEG_END;

use crate::checks::cut_short::{PNG_END, cut_short};
use crate::files::read_file;
use crate::{FrameImage, SceneError};

/// Whether there is nothing in the file; `false` if that cannot be found out.
pub(super) fn is_empty_file(path: &Path) -> bool {
    std::fs::metadata(path).is_ok_and(|metadata| metadata.is_file() && metadata.len() == 0)
}

/// The sizes of a scene's images, given with the positions of their frames, if there are several: the most frequent one, and the first
/// image of another. Of equally frequent sizes, that of the earliest image is named first.
pub(super) fn mixed_sizes(images: &[(usize, ImageSize)]) -> Option<String> {
    let mut counts: BTreeMap<ImageSize, usize> = BTreeMap::new();
    for (_, size) in images {
        *counts.entry(*size).or_default() += 1;
    }
    // Of equal maxima, the last one is taken.
    let common = images.iter().rev().map(|(_, size)| *size).max_by_key(|size| counts.get(size))?;
    let (position, odd) = images.iter().find(|(_, size)| *size != common)?;
    let (count, all) = (counts.get(&common)?, images.len());
    Some(format!("images of several sizes: {common} in {count} of {all}, {odd} in frame {position}"))
}

/// What is wrong with an image whose end is missing.
///
/// # Errors
/// A file that cannot be read, although its header could.
pub(super) fn image_cut_short(image: &FrameImage) -> Result<Option<String>, SceneError> {
    match image {
        FrameImage::Encoded(bytes) => Ok(cut_short(bytes)),
        // Nearly all end with their format's last bytes. Others may have more behind them, so they are read.
        FrameImage::File(path) if !ends_like_an_image(path) => Ok(cut_short(&read_file("reading an image", path)?)),
        _ => Ok(None),
    }
}

fn ends_like_an_image(path: &Path) -> bool {
    let end = || {
        let mut file = atsplat_files::open(path)?;
        let length = file.metadata()?.len();
        file.seek(SeekFrom::Start(length.saturating_sub(PNG_END.len() as u64)))?;
        let mut end = Vec::new();
        file.read_to_end(&mut end).map(|_length| end)
    };
    end().is_ok_and(|end: Vec<u8>| end == PNG_END || end.ends_with(&JPEG_END))
}
