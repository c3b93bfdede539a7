use std::borrow::Cow;

use atsplat_metrics::{DECIBEL_CAP, Score, Values, psnr};
use atsplat_model::network::{EncodedScene, Network, Trace};
use atsplat_pixels::Image;
use atsplat_splat::Gaussians;

use super::{ExpansionError, Subject, compared, image, render};

/// A target rendered with expansion in some of the decoder's blocks.
#[derive(Clone, Debug)]
pub struct Stage {
    /// Numbers of the blocks that expand, from 1.
    pub blocks: Vec<usize>,
    /// Number of Gaussians.
    pub gaussians: usize,
    /// The render, not clipped.
    pub image: Image,
    /// PSNR of the clipped render in dB; [`DECIBEL_CAP`] if it equals the ground truth.
    pub psnr: f64,
}

/// Stages by target: expansion in none of the expanding blocks, the first, …, all of them, which is the trace.
pub(super) fn stages(
    network: &Network,
    (encoded, trace): (&EncodedScene, &Trace),
    subject: &Subject,
) -> Result<Vec<Vec<Stage>>, ExpansionError> {
    let (mut by_target, mut enabled) = (vec![Vec::new(); subject.targets.len()], Vec::new());
    let mut remaining = prefixes(network);
    while let Some((blocks, first)) = remaining.next() {
        enabled.extend(blocks);
        let gaussians: Cow<'_, Gaussians> = if remaining.len() == 0 {
            Cow::Borrowed(&trace.reconstruction.gaussians)
        } else {
            let fewer = network.with_expansion_in_first(first);
            Cow::Owned(fewer.reconstruct_encoded(encoded.clone(), subject.call_seed)?.gaussians)
        };
        for (target, stages) in subject.targets.iter().zip(&mut by_target) {
            let image = image(&render(&gaussians, &target.view, &subject.options)?)?;
            let score = compared(&image, target, |pair| psnr(pair, Values::Clipped))?;
            let psnr = match score {
                Score::Value(value) => value,
                Score::Identical => DECIBEL_CAP,
                Score::NotComputed(reason) => {
                    let (what, expected) = ("render", "an image with a PSNR".to_owned());
                    return Err(ExpansionError::Invalid { what, expected, found: reason.to_string() });
                }
            };
            stages.push(Stage { blocks: enabled.clone(), gaussians: gaussians.len(), image, psnr });
        }
    }
    Ok(by_target)
}

/// For each stage, the block that it enables in addition to the previous stage's, from 1, and the resulting number of blocks
/// with expansion weights. A block that the configuration disables is never enabled.
fn prefixes(network: &Network) -> std::vec::IntoIter<(Option<usize>, usize)> {
    let blocks = network.config().decoder.blocks.iter().enumerate().filter(|(_, block)| block.expansion.is_some());
    let active = blocks.enumerate().filter(|(_, (_, block))| block.active_expansion().is_some());
    let enabled = active.map(|(before, (at, _))| (Some(at + 1), before + 1));
    std::iter::once((None, 0)).chain(enabled).collect::<Vec<_>>().into_iter()
}
