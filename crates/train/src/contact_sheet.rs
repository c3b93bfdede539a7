//! Contact sheets: context views, renders and ground truth of some samples.

use atsplat_model::network::Network;
use atsplat_pixels::{Image, ImageU8, Rounding};

use crate::TrainError;
use crate::evaluation::{Evaluation, image, scores};

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
        let context = (0..sample.context.cameras.len()).map(|view| shown(&image(&sample.context, view)?));
        let (mut pairs, mut psnr) = (Vec::new(), Vec::new());
        for (target, render) in evaluation.renders(network, sample)?.into_iter().enumerate() {
            let truth = image(&sample.targets, target)?;
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
