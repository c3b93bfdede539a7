use std::sync::Arc;

use atsplat_model::network::Views;
use atsplat_pixels::ImageU8;
use atsplat_protocol::trial::{ContextView, TargetPictures, Trial};
use atsplat_splat::{RenderOptions, View};

use super::ExpansionError;
use crate::context::trial_seed;
use crate::network_views;

/// A scene as network and renderer take it.
#[derive(Clone, Debug)]
pub struct Subject {
    /// The context.
    pub views: Views,
    /// What random selection draws with.
    pub call_seed: u64,
    /// How targets are rendered.
    pub options: RenderOptions,
    /// What is rendered; without any, families alone are found.
    pub targets: Vec<Target>,
}

/// A view with its truth.
#[derive(Clone, Debug)]
pub struct Target {
    /// Position of the frame in the scene.
    pub frame: usize,
    /// Camera in the context's world, and size of the picture.
    pub view: View,
    /// What is to be seen.
    pub truth: Arc<ImageU8>,
}

impl Subject {
    /// A trial with some of its targets, by position; pictures are decoded now.
    ///
    /// # Errors
    /// [`ExpansionError::Protocol`] for a picture that cannot be read, [`ExpansionError::Model`] for a context without a
    /// picture or with pictures of several sizes, [`ExpansionError::Unfit`] for a target that is none of the trial's.
    pub fn of(
        trial: &Trial,
        truths: &TargetPictures,
        positions: &[usize],
        options: RenderOptions,
        call_seed: u64,
    ) -> Result<Self, ExpansionError> {
        let target = |&position: &usize| {
            let (target, truth) =
                trial.targets().get(position).zip(truths.get(position)).ok_or_else(|| ExpansionError::Unfit {
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

fn views(trial: &Trial) -> Result<Views, ExpansionError> {
    let decoded: Vec<Arc<ImageU8>> = trial.context().iter().map(ContextView::picture).collect::<Result<_, _>>()?;
    let cameras = trial.context().iter().map(|view| view.camera).collect();
    Ok(network_views(decoded.iter().map(AsRef::as_ref), cameras)?)
}
