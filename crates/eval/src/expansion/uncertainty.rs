use atsplat_camera::ImageSize;
use atsplat_metrics::{Ssim, Values, ssim_map};
use atsplat_model::network::Trace;
use atsplat_numeric::rank_correlation;
use atsplat_pixels::Image;
use atsplat_splat::{Channels, Gaussians, RenderOptions};

use super::{ExpansionError, Target, compared, image, render};

/// Actual error, predicted uncertainty and selected tokens of the intermediate Gaussians that enter a block. Maps have one
/// value per pixel, row-major.
#[derive(Clone, Debug)]
pub struct Uncertainty {
    /// Number of the decoder block, from 1.
    pub block: usize,
    /// Size of the maps in pixels.
    pub size: ImageSize,
    /// Render of the intermediate Gaussians, not clipped.
    pub render: Image,
    /// `1 − SSIM` of the render, as 3DGS's training computes it: the target of the uncertainty prediction.
    pub error: Vec<f64>,
    /// The tokens' scores, composited like a colour over 0.
    pub predicted: Vec<f64>,
    /// Opacity of the Gaussians of the selected tokens alone.
    pub selected_alpha: Vec<f64>,
    /// Number of tokens that the block expanded.
    pub selected: usize,
    /// Number of tokens that entered it.
    pub tokens: usize,
    /// Spearman's rank correlation of error and prediction over pixels; `None` if one of them is constant.
    pub correlation: Option<f64>,
}

/// Uncertainty of the last block that scores its tokens.
pub(super) fn uncertainty_of_last_block(
    trace: &Trace,
    target: &Target,
    options: &RenderOptions,
) -> Result<Option<Uncertainty>, ExpansionError> {
    let Some(last) = trace.reconstruction.blocks.iter().rposition(|block| block.scores.is_some()) else {
        return Ok(None);
    };
    uncertainty_of_block(trace, last, target, options)
}

/// Uncertainty of a block, counted from 0; `None` if it does not score its tokens.
pub(super) fn uncertainty_of_block(
    trace: &Trace,
    index: usize,
    target: &Target,
    options: &RenderOptions,
) -> Result<Option<Uncertainty>, ExpansionError> {
    let Some((block, gaussians)) = trace.reconstruction.blocks.get(index).zip(trace.entering.get(index)) else {
        return Ok(None);
    };
    let Some(scores) = &block.scores else { return Ok(None) };
    let Some(per_token) = gaussians.len().checked_div(scores.len()) else { return Ok(None) };

    let mut parts = gaussians.parts().clone();
    parts.scalars = Some(scores.iter().flat_map(|&score| std::iter::repeat_n(score, per_token)).collect());
    let channels = Channels { scalar: true, ..Channels::default() };
    let rendering = render(&Gaussians::new(parts)?, &target.view, &RenderOptions { channels, ..options.clone() })?;
    let seen = image(&rendering)?;
    let similarity = compared(&seen, target, |pair| ssim_map(pair, Values::AsRendered, Ssim::INRIA))??;
    let error: Vec<f64> = similarity.iter().map(|similarity| 1.0 - similarity).collect();
    let predicted: Vec<f64> = rendering.scalar.iter().flatten().copied().map(f64::from).collect();

    let of_selected: Vec<usize> =
        block.selected.iter().flat_map(|token| token * per_token..(token + 1) * per_token).collect();
    let chosen = render(&gaussians.select(&of_selected)?, &target.view, options)?;
    Ok(Some(Uncertainty {
        block: index + 1,
        size: rendering.size,
        render: seen,
        correlation: rank_correlation(&error, &predicted),
        error,
        predicted,
        selected_alpha: chosen.alpha.into_iter().map(f64::from).collect(),
        selected: block.selected.len(),
        tokens: scores.len(),
    }))
}
