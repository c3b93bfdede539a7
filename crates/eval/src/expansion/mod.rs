//! Adaptive Token Expansion in one scene: the data of the paper's explanatory figures.
//!
//! - [`ExpandedToken`]: positions of children around their parents (paper, "Behavior of expanded tokens");
//! - [`Stage`]: renders with expansion in more and more blocks (supplement, "Expansion at each decoder block");
//! - [`Uncertainty`]: whether expanded regions are those with errors ("Predicted uncertainty and selected tokens").
//!
//! [`study`] analyses single scenes for images, [`measure_trial()`] all trials of a dataset for an [`ExpansionReport`]; their results
//! are not part of a results store.

mod expanded_tokens;
mod gap;
mod measure;
mod report;
mod scene;
mod stages;
mod subject;
#[cfg(test)]
pub(crate) mod tests;
pub mod thresholds;
mod uncertainty;

use atsplat_metrics::Pair;
use atsplat_model::network::{Network, Trace};
use atsplat_pixels::Image;
use atsplat_splat::cpu::CpuRenderer;
use atsplat_splat::{Channels, Gaussians, RenderOptions, Rendering, View};
use thiserror::Error;

pub use expanded_tokens::{ExpandedToken, ProjectedToken, projected_tokens};
pub use gap::ExpansionGap;
pub use measure::{BlockMeasurement, Spread, TrialMeasurement, measure_trial};
pub use report::{BlockRow, ExpansionReport, MeanOverScenes, ThresholdRow};
pub use scene::{ExpansionScene, ExpansionTarget, study_trial};
pub use stages::Stage;
pub(crate) use subject::views as context_views;
pub use subject::{Subject, Target};
pub use uncertainty::Uncertainty;

/// Analysis of token expansion in a scene.
#[derive(Clone, Debug)]
pub struct Study {
    /// Every expanded token with its children, block by block.
    pub expanded_tokens: Vec<ExpandedToken>,
    /// One per target of the subject.
    pub targets: Vec<TargetStudy>,
    /// The forward pass.
    pub trace: Trace,
}

/// Analysis of one target.
#[derive(Clone, Debug)]
pub struct TargetStudy {
    /// Renders with expansion in none of the blocks that expand, the first, the first two, …, all.
    pub stages: Vec<Stage>,
    /// Depth of the final Gaussians, composited and divided by their opacity; row-major, 0 where nothing is drawn.
    pub depth: Vec<f64>,
    /// That of the last block that scores its tokens; `None` if no block does.
    pub uncertainty: Option<Uncertainty>,
}

/// Why a scene cannot be analysed.
#[derive(Debug, Error)]
#[expect(missing_docs, reason = "the message explains the fields")]
#[non_exhaustive]
pub enum ExpansionError {
    /// The network rejects the views or returns non-finite numbers.
    #[error(transparent)]
    Model(#[from] atsplat_model::ModelError),
    /// The renderer rejects a view.
    #[error("rendering: {0}")]
    Splat(#[from] atsplat_splat::SplatError),
    /// A render and its ground truth cannot be compared.
    #[error(transparent)]
    Metric(#[from] atsplat_metrics::MetricError),
    /// An image cannot be read.
    #[error(transparent)]
    Protocol(#[from] atsplat_protocol::ProtocolError),
    /// An invalid camera.
    #[error(transparent)]
    Camera(#[from] atsplat_camera::CameraError),
    /// A render has the wrong number of samples.
    #[error(transparent)]
    Pixels(#[from] atsplat_pixels::PixelError),
    /// Input that cannot be analysed, such as a target that the trial does not have.
    #[error("{what}: expected {expected}, found {found}")]
    Invalid { what: &'static str, expected: String, found: String },
}

/// Encodes a scene once and expands its tokens in full, then with each smaller number of expanding blocks.
///
/// # Errors
/// [`ExpansionError`] if the network rejects the views, the renderer rejects a target, or a ground truth has another size.
pub fn study(network: &Network, subject: &Subject) -> Result<Study, ExpansionError> {
    let encoded = network.encode_scene(&subject.views)?;
    let trace = network.trace_encoded(encoded.clone(), subject.call_seed)?;
    let expanded_tokens = expanded_tokens::expanded_tokens(&trace);
    if subject.targets.is_empty() {
        return Ok(Study { expanded_tokens, targets: Vec::new(), trace });
    }
    let stages = stages::stages(network, (&encoded, &trace), subject)?;
    let targets = subject.targets.iter().zip(stages).map(|(target, stages)| {
        let uncertainty = uncertainty::uncertainty_of_last_block(&trace, target, &subject.options)?;
        let depth = depth(&trace.reconstruction.gaussians, &target.view, &subject.options)?;
        Ok(TargetStudy { stages, depth, uncertainty })
    });
    let targets = targets.collect::<Result<_, ExpansionError>>()?;
    Ok(Study { expanded_tokens, targets, trace })
}

fn render(gaussians: &Gaussians, view: &View, options: &RenderOptions) -> Result<Rendering<f32>, ExpansionError> {
    Ok(CpuRenderer::default().render(gaussians, view, options)?)
}

fn depth(gaussians: &Gaussians, view: &View, options: &RenderOptions) -> Result<Vec<f64>, ExpansionError> {
    let channels = Channels { depth: true, ..Channels::default() };
    let rendering = render(gaussians, view, &RenderOptions { channels, ..options.clone() })?;
    let pixels = rendering.depth.iter().flatten().zip(&rendering.alpha);
    Ok(pixels.map(|(depth, alpha)| if *alpha > 0.0 { f64::from(*depth / *alpha) } else { 0.0 }).collect())
}

fn image(rendering: &Rendering<f32>) -> Result<Image, ExpansionError> {
    let samples = rendering.rgb.as_flattened().to_vec();
    Ok(Image::new(rendering.size.width, rendering.size.height, samples)?)
}

/// Compares a render with its ground truth, which must be finite and of equal size.
fn compared<T>(render: &Image, target: &Target, with: impl FnOnce(&Pair<'_>) -> T) -> Result<T, ExpansionError> {
    let truth = Image::from_u8(&target.truth);
    Ok(with(&Pair::new(render, &truth)?))
}
