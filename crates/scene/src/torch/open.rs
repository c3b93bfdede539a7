//! How `.torch` chunks are detected and opened.

use std::path::Path;

use super::chunks::{chunks_in, stages};
use super::{INDEX, TorchChunks, is_named_chunk};
use crate::SceneError;
use crate::format::{FormatReader, ImagePlace};

pub(crate) static READER: FormatReader = FormatReader {
    data: ".torch chunks",
    required: |_| "chunk".to_owned(),
    images: ImagePlace::WithCameras,
    part_of_scene: |_| None,
    is_of_captures: false,
    image_options: &[],
    reads_file: |path| is_named_chunk(path) || is_index(path),
    path_of_file: |path, start| is_chunk(start).then(|| path.to_owned()),
    is_folder_of_format: has_chunks,
    read_to_open: |path| if has_chunks(path)? { TorchChunks::read_to_open(path) } else { Ok(Vec::new()) },
    open: |path, options, warnings| {
        let source = if options.fetch.is_some() {
            TorchChunks::open_by_index(path, warnings)?
        } else {
            TorchChunks::open(path, warnings)?
        };
        let collections = source.collections(path);
        Ok((Box::new(source), collections))
    },
};

/// Whether a file starts like a zip archive or with the magic number of `torch.save` before it wrote archives.
fn is_chunk(start: &[u8]) -> bool {
    const LEGACY_MAGIC: [u8; 14] = [0x80, 0x02, 0x8a, 0x0a, 0x6c, 0xfc, 0x9c, 0x46, 0xf9, 0x20, 0x6a, 0xa8, 0x50, 0x19];
    start.starts_with(b"PK\x03\x04") || start.starts_with(&LEGACY_MAGIC)
}

/// Whether there are chunks in the folder, or in that of a stage.
fn has_chunks(folder: &Path) -> Result<bool, SceneError> {
    for stage in stages(folder) {
        if !chunks_in(&stage)?.is_empty() {
            return Ok(true);
        }
    }
    Ok(false)
}

/// Whether a file is the index of the chunks next to it.
fn is_index(path: &Path) -> bool {
    let is_named_so = path.file_name().is_some_and(|name| name == INDEX);
    let contains_chunk = |folder: &Path| chunks_in(folder).is_ok_and(|chunks| !chunks.is_empty());
    is_named_so && path.parent().is_some_and(contains_chunk)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn chunks_are_recognised_by_their_first_bytes() {
        assert!(is_chunk(b"PK\x03\x04rest"));
        assert!(is_chunk(b"\x80\x02\x8a\x0al\xfc\x9cF\xf9 j\xa8P\x19.\x80\x02M"));
        assert!(!is_chunk(b"\x80\x02}q\x00"), "any other pickle");
    }
}
