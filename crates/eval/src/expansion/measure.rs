use atsplat_model::network::{Network, Trace};
use atsplat_numeric::{mean, median};
use atsplat_protocol::trial::{TargetImages, Trial};
use atsplat_splat::{RenderOptions, View};
use glam::DVec2;

use super::expanded_tokens::expanded_tokens;
use super::uncertainty::uncertainty_of_block;
use super::{ExpandedToken, ExpansionError, Subject, Uncertainty, projected_tokens};

/// Token expansion in one trial.
#[derive(Clone, Debug)]
pub struct TrialMeasurement {
    /// Key of the scene.
    pub scene: String,
    /// The blocks that expanded a token or scored their tokens, in order.
    pub blocks: Vec<BlockMeasurement>,
}

/// One block of the decoder in one trial.
#[derive(Clone, Debug, PartialEq)]
pub struct BlockMeasurement {
    /// Its number, from 1.
    pub block: usize,
    /// Number of tokens that entered it.
    pub tokens: usize,
    /// Number of tokens that it expanded.
    pub expanded: usize,
    /// Predicted uncertainty of every token; empty if the block does not score tokens.
    pub scores: Vec<f64>,
    /// Spearman's rank correlation of error and composited prediction over a target's pixels, mean over targets.
    pub correlation: Option<f64>,
    /// Mean error where the expanded tokens' Gaussians cover a target, divided by that elsewhere, mean over targets.
    pub contrast: Option<f64>,
    /// Medians over the expanded tokens that the first context view sees.
    pub children: Option<Spread>,
}

/// How the children of a token are distributed around it, in pixels of the first context view.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Spread {
    /// Root mean square of the children's distances from their mean position; 0 if they collapse into one.
    pub of_children: f64,
    /// Distance of that mean position from the parent; if it is larger, the children moved to one side.
    pub from_parent: f64,
}

/// Runs a network on a trial and measures each block on all targets.
///
/// # Errors
/// Those of [`Subject::of`] and [`study`](super::study).
pub fn measure_trial(
    network: &Network,
    (trial, truths): (&Trial, &TargetImages),
    options: RenderOptions,
    call_seed: u64,
) -> Result<TrialMeasurement, ExpansionError> {
    let targets: Vec<usize> = (0..trial.targets().len()).collect();
    let subject = Subject::of(trial, truths, &targets, options, call_seed)?;
    let trace = network.trace(&subject.views, subject.call_seed)?;
    let expanded_tokens = expanded_tokens(&trace);
    let first = trial.context().first().map(|view| View { camera: view.camera, size: view.size });
    let mut blocks = Vec::new();
    for (index, made) in trace.reconstruction.blocks.iter().enumerate() {
        let scores: Vec<f64> = made.scores.iter().flatten().copied().map(f64::from).collect();
        if scores.is_empty() && made.selected.is_empty() {
            continue;
        }
        let predictions = predictions(&trace, index, &subject)?;
        let of_this_block: Vec<ExpandedToken> =
            expanded_tokens.iter().filter(|expanded| expanded.block == index + 1).cloned().collect();
        blocks.push(BlockMeasurement {
            block: index + 1,
            tokens: made.parents.iter().max().map_or(0, |last| last + 1),
            expanded: made.selected.len(),
            scores,
            correlation: mean(predictions.iter().filter_map(|prediction| prediction.correlation)),
            contrast: mean(predictions.iter().filter_map(contrast)),
            children: first.as_ref().map(|view| spread(&of_this_block, view)).transpose()?.flatten(),
        });
    }
    Ok(TrialMeasurement { scene: trial.scene().to_owned(), blocks })
}

/// The uncertainty in each target; empty if the block does not score its tokens.
fn predictions(trace: &Trace, index: usize, subject: &Subject) -> Result<Vec<Uncertainty>, ExpansionError> {
    let of_target = |target| uncertainty_of_block(trace, index, target, &subject.options).transpose();
    subject.targets.iter().filter_map(of_target).collect()
}

/// Mean error where the expanded tokens' Gaussians cover the target, divided by that elsewhere.
fn contrast(uncertainty: &Uncertainty) -> Option<f64> {
    let weighted = |weight: &dyn Fn(f64) -> f64| {
        let (mut sum, mut total) = (0.0, 0.0);
        for (error, alpha) in uncertainty.error.iter().zip(&uncertainty.selected_alpha) {
            let weight = weight(*alpha);
            sum += error * weight;
            total += weight;
        }
        (total > 0.0).then(|| sum / total)
    };
    let (inside, outside) = (weighted(&|alpha| alpha)?, weighted(&|alpha| 1.0 - alpha)?);
    (outside > 0.0).then(|| inside / outside)
}

/// `None` if the view sees no expanded token of which at least two children are in front of the camera.
fn spread(expanded_tokens: &[ExpandedToken], view: &View) -> Result<Option<Spread>, ExpansionError> {
    let seen = projected_tokens(expanded_tokens, view)?;
    let siblings = seen.iter().filter(|expanded| expanded.children.len() > 1);
    let (spreads, shifts): (Vec<f64>, Vec<f64>) = siblings
        .map(|expanded| {
            let children: Vec<DVec2> = expanded.children.iter().copied().map(DVec2::from).collect();
            let count = children.len() as f64;
            let centre = children.iter().sum::<DVec2>() / count;
            let squares: f64 = children.iter().map(|child| child.distance_squared(centre)).sum();
            ((squares / count).sqrt(), centre.distance(DVec2::from(expanded.parent)))
        })
        .unzip();
    Ok(median(spreads).zip(median(shifts)).map(|(of_children, from_parent)| Spread { of_children, from_parent }))
}

#[cfg(test)]
mod tests {
    use atsplat_camera::{Camera, CameraFromWorld, ImageSize, NormalizedIntrinsics};
    use atsplat_numeric::Tolerance;
    use atsplat_pixels::Image;
    use glam::DVec3;

    use super::*;
    use crate::expansion::study;
    use crate::expansion::tests::{nano, network, trial};

    #[test]
    fn blocks_are_those_of_the_study() {
        let (trial, truths) = trial();
        let network = network(&nano());
        let found = measure_trial(&network, (&trial, &truths), RenderOptions::default(), 0).unwrap();
        assert_eq!(found.scene, trial.scene());
        let subject = Subject::of(&trial, &truths, &[0, 1], RenderOptions::default(), 0).unwrap();
        let studied = study(&network, &subject).unwrap();
        let budget = &studied.trace.reconstruction.budget;
        assert_eq!(found.blocks.iter().map(|block| block.block).collect::<Vec<_>>(), [2, 3, 4]);
        for measured in &found.blocks {
            assert_eq!(measured.expanded, budget.expanded[measured.block - 1]);
            assert_eq!(measured.tokens, studied.trace.entering[measured.block - 1].len() / 16);
            assert_eq!(measured.scores.len(), measured.tokens);
            assert!(measured.children.unwrap().of_children > 0.0 && measured.contrast.unwrap() > 0.0);
        }
        let last = studied.targets.iter().filter_map(|target| target.uncertainty.as_ref().unwrap().correlation);
        Tolerance::F64.assert([found.blocks[2].correlation.unwrap()], [mean(last).unwrap()], "the last block");
        assert_ne!(found.blocks[0].correlation, found.blocks[1].correlation);
    }

    #[test]
    fn contrast_is_above_one_where_errors_are_selected() {
        let of = |selected_alpha: &[f64]| {
            contrast(&Uncertainty {
                block: 2,
                size: ImageSize { width: 4, height: 1 },
                render: Image::new(1, 1, vec![0.0; 3]).unwrap(),
                error: vec![0.6, 0.2, 0.1, 0.1],
                predicted: Vec::new(),
                selected_alpha: selected_alpha.to_vec(),
                selected: 1,
                tokens: 2,
                correlation: None,
            })
        };
        Tolerance::F64.assert([of(&[1.0, 0.5, 0.0, 0.0]).unwrap()], [(0.7 / 1.5) / (0.3 / 2.5)], "errors");
        assert!(of(&[0.0, 0.0, 1.0, 0.5]).unwrap() < 1.0);
        assert_eq!((of(&[0.0; 4]), of(&[1.0; 4])), (None, None));
    }

    #[test]
    fn spread_and_shift_are_apart() {
        let camera = Camera::pinhole(CameraFromWorld::IDENTITY, NormalizedIntrinsics::new(1.0, 1.0, 0.5, 0.5).unwrap());
        let view = View { camera, size: ImageSize { width: 100, height: 100 } };
        let expanded = |children: &[[f64; 2]]| ExpandedToken {
            block: 2,
            score: None,
            parent: DVec3::Z,
            children: children.iter().map(|[x, y]| DVec3::new(*x, *y, 1.0)).collect(),
        };
        let of = |expanded_tokens: &[ExpandedToken]| spread(expanded_tokens, &view).unwrap();
        let found = of(&[expanded(&[[0.02, 0.0], [0.06, 0.0]]), expanded(&[[0.1, 0.1]])]).unwrap();
        Tolerance::absolute(1e-9).assert([found.of_children, found.from_parent], [2.0, 4.0], "both to one side");
        let found = of(&[expanded(&[[0.03, -0.04], [-0.03, 0.04]])]).unwrap();
        Tolerance::absolute(1e-9).assert([found.of_children, found.from_parent], [5.0, 0.0], "around the parent");
        assert_eq!(of(&[expanded(&[[0.1, 0.1]])]), None);
        // Spreads of 1, 9 and 2 pixels around 20, 4 and 3.
        let three = [[0.19, 0.21], [-0.05, 0.13], [0.01, 0.05]].map(|[a, b]| expanded(&[[a, 0.0], [b, 0.0]]));
        let found = of(&three).unwrap();
        Tolerance::absolute(1e-9).assert([found.of_children, found.from_parent], [2.0, 4.0], "medians");
    }
}
