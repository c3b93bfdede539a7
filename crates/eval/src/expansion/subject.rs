use std::sync::Arc;

use atsplat_model::network::Views;
use atsplat_pixels::ImageU8;
use atsplat_protocol::trial::{ContextView, TargetImages, Trial};
use atsplat_splat::{RenderOptions, View};

use super::ExpansionError;
use crate::method::trial_seed;

/// The scene to analyse, as input of network and renderer.
#[derive(Clone, Debug)]
pub struct Subject {
    /// The context views.
    pub views: Views,
    /// Seed of the forward pass, which random token selection draws from.
    pub call_seed: u64,
    /// How targets are rendered.
    pub options: RenderOptions,
    /// The views to render; without any, only expanded tokens are computed.
    pub targets: Vec<Target>,
}

/// A view with its ground truth.
#[derive(Clone, Debug)]
pub struct Target {
    /// Position of the frame in the scene.
    pub frame: usize,
    /// Camera in the context's world frame, and image size.
    pub view: View,
    /// The ground truth.
    pub truth: Arc<ImageU8>,
}

impl Subject {
    /// A trial with some of its targets, given by position; images are decoded here. Random token expansion draws the same
    /// tokens as in an evaluation with this `call_seed`.
    ///
    /// # Errors
    /// [`ExpansionError::Protocol`] for an image that cannot be read, [`ExpansionError::Model`] for a context without
    /// images or with images of different sizes, [`ExpansionError::Invalid`] for a position that the trial does not have.
    pub fn of(
        trial: &Trial,
        truths: &TargetImages,
        positions: &[usize],
        options: RenderOptions,
        call_seed: u64,
    ) -> Result<Self, ExpansionError> {
        let target = |&position: &usize| {
            let (target, truth) =
                trial.targets().get(position).zip(truths.get(position)).ok_or_else(|| ExpansionError::Invalid {
                    what: "target",
                    expected: format!("one of {}", trial.targets().len()),
                    found: position.to_string(),
                })?;
            Ok(Target { frame: target.frame, view: View { camera: target.camera, size: target.size }, truth: truth? })
        };
        let targets = positions.iter().map(target).collect::<Result<_, ExpansionError>>()?;
        Ok(Self { views: views(trial)?, call_seed: trial_seed(call_seed, trial), options, targets })
    }
}

pub(crate) fn views(trial: &Trial) -> Result<Views, ExpansionError> {
    let decoded: Vec<Arc<ImageU8>> = trial.context().iter().map(ContextView::image).collect::<Result<_, _>>()?;
    let cameras = trial.context().iter().map(|view| view.camera).collect();
    Ok(Views::of_images(decoded.iter().map(AsRef::as_ref), cameras)?)
}
