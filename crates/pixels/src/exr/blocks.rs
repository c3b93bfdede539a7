//! Whether the blocks of an EXR, each of which states its place, cover the image.

use std::collections::BTreeSet;
use std::io::Cursor;

use ::exr::block::BlockIndex;
use ::exr::block::chunk::{Chunk, CompressedBlock, TileCoordinates};
use ::exr::math::Vec2;
use ::exr::meta::MetaData;
use ::exr::meta::header::Header;

use super::failed;
use crate::{ImageFormat, PixelError};

/// An error unless the first layer has each block of its largest resolution once. Decoding puts a block where the block
/// itself says, so that the pixels of a missing one would stay 0.
pub(super) fn require_all(bytes: &[u8], header: &Header) -> Result<(), PixelError> {
    let mut missing = BTreeSet::new();
    let reader = ::exr::block::read(Cursor::new(bytes), false).map_err(failed)?;
    // Called after the table of blocks was read: a header of a few bytes may announce millions of them.
    let select = |_: &MetaData, tile: TileCoordinates, block: BlockIndex| {
        let is_read = block.layer == 0 && tile.is_largest_resolution_level();
        if is_read {
            let Vec2(column, row) = block.pixel_position;
            missing.extend(i32::try_from(row).ok().zip(i32::try_from(column).ok()));
        }
        is_read
    };
    let chunks = reader.filter_chunks(false, select).map_err(failed)?;
    let mut stray = None;
    for chunk in chunks {
        let start = stated_start(&chunk.map_err(failed)?, header);
        if !start.is_some_and(|start| missing.remove(&start)) {
            stray = start;
        }
    }
    let Some((row, column)) = missing.first() else { return Ok(()) };
    let found = stray.map_or_else(
        || "one of another place".to_owned(),
        |(row, column)| format!("another that states row {row}, column {column}"),
    );
    let problem = format!("expected a block that starts at row {row}, column {column}, found {found}");
    Err(PixelError::Decode { format: ImageFormat::Exr, source: problem.into() })
}

/// The first row and column of a block within the first layer, as the block states them; `None` for one of another layer, of a
/// smaller resolution, or outside.
fn stated_start(chunk: &Chunk, header: &Header) -> Option<(i32, i32)> {
    if chunk.layer_index != 0 {
        return None;
    }
    match &chunk.compressed_block {
        CompressedBlock::ScanLine(block) => {
            Some((block.y_coordinate.checked_sub(header.own_attributes.layer_position.1)?, 0))
        }
        CompressedBlock::Tile(block) if block.coordinates.is_largest_resolution_level() => {
            let start = header.get_absolute_block_pixel_coordinates(block.coordinates).ok()?.position;
            Some((start.1, start.0))
        }
        _ => None,
    }
}
