//! How `.torch` chunks are detected and opened.

use std::path::Path;

use super::TorchChunks;
use crate::SceneError;
use crate::files::{has_extension, list};
use crate::format::{Format, FormatReader};

pub(crate) const READER: FormatReader = FormatReader {
    format: Format::TorchChunks,
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

/// Whether there are chunks in the folder, or in its `test` or `train` (pixelSplat's layout).
fn has_chunks(folder: &Path) -> Result<bool, SceneError> {
    for stage in ["", "test", "train"].map(|stage| folder.join(stage)) {
        let is_chunk = |name: &str| has_extension(Path::new(name), "torch");
        if stage.is_dir() && list(&stage)?.iter().any(|(name, is_folder)| !is_folder && is_chunk(name)) {
            return Ok(true);
        }
    }
    Ok(false)
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
