//! What Adaptive Token Expansion does in one scene: the figures by which the paper explains it, as data.
//!
//! - [`Family`]: where children lie around their parents (paper, "Behavior of expanded tokens");
//! - [`Stage`]: what is rendered with expansion in ever more blocks (supplement, "Expansion at each decoder block");
//! - [`Uncertainty`]: whether what is expanded is what is wrong ("Predicted uncertainty and selected tokens").
//!
//! Nothing here enters a results store; [`study`] looks at a few scenes for people.

mod error;
mod families;
mod stages;
mod subject;
#[cfg(test)]
mod tests;
mod uncertainty;

use atsplat_metrics::Pair;
use atsplat_model::network::Network;
use atsplat_pixels::Image;
use atsplat_splat::cpu::CpuRenderer;
use atsplat_splat::{Gaussians, RenderOptions, Rendering, View};

pub use error::ExpansionError;
pub use families::{Family, SeenFamily, seen_by};
pub use stages::Stage;
pub use subject::{Subject, Target};
pub use uncertainty::Uncertainty;

/// What expansion did in a scene.
#[derive(Clone, Debug)]
pub struct Study {
    /// Every expanded token with its children, block by block.
    pub families: Vec<Family>,
    /// One for each of the subject's targets.
    pub targets: Vec<TargetStudy>,
}

/// One target under the network.
#[derive(Clone, Debug)]
pub struct TargetStudy {
    /// Renders with expansion in none of the blocks that expand, the first, the first two, …, all.
    pub stages: Vec<Stage>,
    /// Of the last block that scores its tokens; `None` where none does.
    pub uncertainty: Option<Uncertainty>,
}

/// Runs a network on a scene: once whole, and once for each smaller number of blocks that expand.
///
/// # Errors
/// [`ExpansionError`] where the network refuses the views, the renderer the targets, or a truth is of another size.
pub fn study(network: &Network, subject: &Subject) -> Result<Study, ExpansionError> {
    let trace = network.trace(&subject.views, subject.call_seed)?;
    let families = families::families(&trace);
    if subject.targets.is_empty() {
        return Ok(Study { families, targets: Vec::new() });
    }
    let stages = stages::stages(network, &trace, subject)?;
    let targets = subject.targets.iter().zip(stages).map(|(target, stages)| {
        let uncertainty = uncertainty::uncertainty(&trace, target, &subject.options)?;
        Ok(TargetStudy { stages, uncertainty })
    });
    Ok(Study { families, targets: targets.collect::<Result<_, ExpansionError>>()? })
}

fn render(gaussians: &Gaussians, view: &View, options: &RenderOptions) -> Result<Rendering<f32>, ExpansionError> {
    Ok(CpuRenderer::default().render(gaussians, view, options)?)
}

fn image(rendering: &Rendering<f32>) -> Result<Image, ExpansionError> {
    let samples = rendering.rgb.as_flattened().to_vec();
    Ok(Image::new(rendering.size.width, rendering.size.height, samples)?)
}

/// A render beside its truth, of one size and finite.
fn compared<T>(render: &Image, target: &Target, with: impl FnOnce(&Pair<'_>) -> T) -> Result<T, ExpansionError> {
    let truth = Image::from_u8(&target.truth);
    Ok(with(&Pair::new(render, &truth)?))
}
