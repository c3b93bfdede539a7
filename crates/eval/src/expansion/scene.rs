use std::sync::Arc;

use atsplat_model::network::Network;
use atsplat_pixels::ImageU8;
use atsplat_protocol::trial::{TargetImages, Trial};
use atsplat_splat::{RenderOptions, View};

use super::{ExpansionError, ProjectedToken, Subject, TargetStudy, projected_tokens, study};
use crate::live::LiveScene;

/// The expansion of a scene's tokens, seen by one of its cameras.
#[derive(Clone, Debug)]
pub struct ExpansionScene {
    /// The scene's key.
    pub label: String,
    /// The frame over whose image expanded tokens are drawn.
    pub frame: usize,
    /// Its image.
    pub image: Arc<ImageU8>,
    /// Expanded tokens visible in it.
    pub expanded_tokens: Vec<ProjectedToken>,
    /// Number of expanded tokens, visible or not.
    pub expanded: usize,
    /// Targets with their ground truth.
    pub targets: Vec<ExpansionTarget>,
}

/// A target with its ground truth.
#[derive(Clone, Debug)]
pub struct ExpansionTarget {
    /// Position of the frame in the scene.
    pub frame: usize,
    /// The ground truth.
    pub truth: Arc<ImageU8>,
    /// The study's results.
    pub study: TargetStudy,
}

/// Studies a trial under a network: the expanded tokens seen in the first context view, and at most `max_targets`
/// targets. Also returns its Gaussians for a live view.
///
/// # Errors
/// Those of [`Subject::of`] and [`study`].
pub fn study_trial(
    network: &Network,
    (trial, truths): (&Trial, &TargetImages),
    options: RenderOptions,
    call_seed: u64,
    max_targets: usize,
) -> Result<(ExpansionScene, LiveScene), ExpansionError> {
    let positions = spread_inside(trial.targets().len(), max_targets);
    let subject = Subject::of(trial, truths, &positions, options, call_seed)?;
    let studied = study(network, &subject)?;
    let live = LiveScene::of(&studied.trace, trial, &subject.options)?;
    let first = trial.context().first().ok_or_else(|| ExpansionError::Invalid {
        what: "context",
        expected: "at least one view".to_owned(),
        found: "none".to_owned(),
    })?;
    let view = View { camera: first.camera, size: first.size };
    let targets = subject.targets.into_iter().zip(studied.targets);
    let targets = targets.map(|(target, study)| ExpansionTarget { frame: target.frame, truth: target.truth, study });
    let scene = ExpansionScene {
        label: trial.scene().to_owned(),
        frame: first.frame,
        image: first.image()?,
        expanded_tokens: projected_tokens(&studied.expanded_tokens, &view)?,
        expanded: studied.expanded_tokens.len(),
        targets: targets.collect(),
    };
    Ok((scene, live))
}

/// At most `max` positions, spread evenly with a margin at both ends: a single position is the middle one.
fn spread_inside(all: usize, max: usize) -> Vec<usize> {
    let count = max.min(all);
    let step = |at: usize| (2 * at + 1) * all / (2 * count);
    (0..count).map(step).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn targets_are_spread_around_the_middle() {
        assert_eq!(spread_inside(5, 1), [2]);
        assert_eq!(spread_inside(8, 2), [2, 6]);
        assert_eq!(spread_inside(3, 9), [0, 1, 2]);
        assert_eq!((spread_inside(0, 2), spread_inside(2, 0)), (vec![], vec![]));
    }
}
