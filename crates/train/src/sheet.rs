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

/// Rows of pictures with white gaps; shorter rows end in white.
///
/// # Errors
/// [`TrainError::Pixels`] for a sheet without pictures.
pub fn lay_out(rows: &[Vec<Image>]) -> Result<Image, TrainError> {
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
