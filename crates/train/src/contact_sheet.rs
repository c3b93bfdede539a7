//! Contact sheets: context views, renders and ground truth of some samples.

use atsplat_model::network::Network;
use atsplat_numeric::mean;
use atsplat_pixels::{Image, ImageU8, Rounding};

use crate::TrainError;
use crate::evaluation::{Evaluation, image};

/// A sample as a contact sheet shows it.
#[derive(Clone, Debug)]
pub struct SheetRow {
    /// The context views.
    pub context: Vec<ImageU8>,
    /// Each target's render and ground truth.
    pub targets: Vec<[ImageU8; 2]>,
    /// Mean PSNR in dB of all targets that an evaluation counts; `None` if it counts none.
    pub psnr: Option<f64>,
    /// Numbers, from 1, of the targets that it leaves out, as they equal their nearest context view or render.
    pub left_out: Vec<usize>,
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
        let context = (0..sample.context.cameras.len()).map(|view| shown(&image(&sample.context, view)?));
        let (mut pairs, mut psnr, mut left_out) = (Vec::new(), Vec::new(), Vec::new());
        for (number, target) in (1..).zip(evaluation.scored(network, sample)?) {
            match target.counted_psnr() {
                Some(counted) => psnr.push(counted),
                None => left_out.push(number),
            }
            if number <= targets {
                pairs.push([shown(&target.render)?, shown(&target.truth)?]);
            }
        }
        let context = context.collect::<Result<_, TrainError>>()?;
        Ok(SheetRow { context, targets: pairs, psnr: mean(psnr), left_out })
    };
    evaluation.samples().iter().take(rows).map(row).collect()
}

fn shown(image: &Image) -> Result<ImageU8, TrainError> {
    Ok(image.to_u8(Rounding::Nearest)?)
}
