//! Contact sheets: context views, renders and ground truth of some samples.

use atsplat_model::network::Network;
use atsplat_pixels::{Image, ImageU8, Rounding};

use crate::TrainError;
use crate::evaluation::{Evaluation, picture, scores};

/// A sample as a contact sheet shows it.
#[derive(Clone, Debug)]
pub struct SheetRow {
    /// The context views.
    pub context: Vec<ImageU8>,
    /// Each target's render and ground truth.
    pub targets: Vec<[ImageU8; 2]>,
    /// Mean PSNR of all targets in dB.
    pub psnr: f64,
}

/// The first `rows` samples, each with its first `targets` targets.
///
/// # Errors
/// As [`Evaluation::renders`].
pub fn contact_sheet(
    evaluation: &Evaluation,
    network: &Network,
    rows: usize,
    targets: usize,
) -> Result<Vec<SheetRow>, TrainError> {
    let row = |sample: &crate::samples::Sample| {
        let context = (0..sample.context.cameras.len()).map(|view| shown(&picture(&sample.context, view)?));
        let (mut pairs, mut psnr) = (Vec::new(), Vec::new());
        for (target, render) in evaluation.renders(network, sample)?.into_iter().enumerate() {
            let truth = picture(&sample.targets, target)?;
            psnr.push(scores(&render, &truth)?.psnr);
            if target < targets {
                pairs.push([shown(&render)?, shown(&truth)?]);
            }
        }
        Ok(SheetRow {
            context: context.collect::<Result<_, TrainError>>()?,
            targets: pairs,
            psnr: psnr.iter().sum::<f64>() / psnr.len().max(1) as f64,
        })
    };
    evaluation.samples().iter().take(rows).map(row).collect()
}

fn shown(image: &Image) -> Result<ImageU8, TrainError> {
    Ok(image.to_u8(Rounding::Nearest)?)
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
