//! Contact sheets: context views, renders and ground truth side by side.

use atsplat_model::ImageSize;
use atsplat_model::network::Network;
use atsplat_pixels::{Image, ImageU8, Rounding};

use crate::TrainError;
use crate::evaluation::{Evaluation, picture};
use crate::samples::pixel_size;

/// White pixels between pictures.
const GAP: usize = 4;

/// One row per sample: its context, then at most `pairs` pairs of a render and its ground truth.
///
/// # Errors
/// As [`Evaluation::renders`].
pub fn contact_sheet(
    evaluation: &Evaluation,
    network: &Network,
    rows: usize,
    pairs: usize,
) -> Result<ImageU8, TrainError> {
    let mut sheet = Vec::new();
    for sample in evaluation.samples().iter().take(rows) {
        let mut row = Vec::new();
        for view in 0..sample.context.cameras.len() {
            row.push(picture(&sample.context, view)?);
        }
        for (target, render) in evaluation.renders(network, sample)?.into_iter().enumerate().take(pairs) {
            row.push(render);
            row.push(picture(&sample.targets, target)?);
        }
        sheet.push(row);
    }
    Ok(lay_out(&sheet)?.to_u8(Rounding::Nearest)?)
}

fn lay_out(rows: &[Vec<Image>]) -> Result<Image, TrainError> {
    let side = |of: fn(&Image) -> u32| rows.iter().flatten().map(of).max().unwrap_or(0) as usize + GAP;
    let (cell_width, cell_height) = (side(Image::width), side(Image::height));
    let columns = rows.iter().map(Vec::len).max().unwrap_or(0);
    let (width, height) = (columns * cell_width + GAP, rows.len() * cell_height + GAP);
    let mut samples = vec![1.0; width * height * 3];
    for (y, row) in rows.iter().enumerate() {
        for (x, image) in row.iter().enumerate() {
            let line = image.width() as usize * 3;
            for (dy, from) in image.samples().chunks_exact(line.max(1)).enumerate() {
                let at = ((GAP + y * cell_height + dy) * width + GAP + x * cell_width) * 3;
                if let Some(into) = samples.get_mut(at..at + line) {
                    into.iter_mut().zip(from).for_each(|(slot, value)| *slot = value.clamp(0.0, 1.0));
                }
            }
        }
    }
    let size = pixel_size(ImageSize::new(height, width));
    Ok(Image::new(size.width, size.height, samples)?)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The largest picture has 3×5 pixels, so that a cell has 7×9.
    #[test]
    fn pictures_start_at_the_corners_of_cells_between_white_gaps() {
        let plain = |width: u32, height: u32, level: f32| {
            Image::new(width, height, vec![level; width as usize * height as usize * 3]).unwrap()
        };
        let rows = [
            vec![plain(3, 2, 0.1), plain(2, 5, 0.2)],
            vec![plain(1, 1, -1.0)],
            vec![plain(3, 5, 0.4), plain(1, 5, 0.5), plain(3, 5, 2.0)],
        ];
        let sheet = lay_out(&rows).unwrap();
        assert_eq!((sheet.width(), sheet.height()), (3 * 7 + 4, 3 * 9 + 4));
        let placed = [
            (4..7, 4..6, 0.1),
            (11..13, 4..9, 0.2),
            (4..5, 13..14, 0.0),
            (4..7, 22..27, 0.4),
            (11..12, 22..27, 0.5),
            (18..21, 22..27, 1.0),
        ];
        for (at, pixel) in sheet.samples().as_chunks::<3>().0.iter().enumerate() {
            let (column, row) = (at % 25, at / 25);
            let inside = placed.iter().find(|(columns, rows, _)| columns.contains(&column) && rows.contains(&row));
            assert_eq!(*pixel, [inside.map_or(1.0, |(_, _, level)| *level); 3], "column {column}, row {row}");
        }
    }
}
