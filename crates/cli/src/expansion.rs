//! Plots of what Adaptive Token Expansion does in a scene, for the commands that have a network and a trial.

use anyhow::Context as _;
use atsplat_eval::expansion::{Subject, seen_by, study};
use atsplat_model::network::Network;
use atsplat_protocol::trial::{TargetPictures, Trial};
use atsplat_report::figures::{ExpansionScene, ExpansionTarget};
use atsplat_splat::{RenderOptions, View};

/// What is said of random weights wherever their expansion is shown.
pub(crate) const UNTRAINED: &str = "UNTRAINED, random weights";

/// A trial under a network, its families in the first context picture, with at most so many of its targets.
pub(crate) fn studied(
    network: &Network,
    (trial, truths): (&Trial, &TargetPictures),
    options: RenderOptions,
    call_seed: u64,
    most_targets: usize,
) -> anyhow::Result<ExpansionScene> {
    let positions = spread_inside(trial.targets().len(), most_targets);
    let subject = Subject::of(trial, truths, &positions, options, call_seed)?;
    let found = study(network, &subject)?;
    let first = trial.context().first().context("no view")?;
    let view = View { camera: first.camera, size: first.size };
    let targets = subject.targets.into_iter().zip(found.targets);
    let targets = targets.map(|(target, study)| ExpansionTarget { frame: target.frame, truth: target.truth, study });
    Ok(ExpansionScene {
        label: trial.scene().to_owned(),
        frame: first.frame,
        picture: first.picture()?,
        families: seen_by(&found.families, &view)?,
        expanded: found.families.len(),
        targets: targets.collect(),
    })
}

/// Positions as far from the ends as from each other: a single target is the one in the middle.
fn spread_inside(all: usize, most: usize) -> Vec<usize> {
    let count = most.min(all);
    let step = |at: usize| (2 * at + 1) * all / (2 * count);
    (0..count).map(step).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn targets_are_taken_from_the_middle() {
        assert_eq!(spread_inside(5, 1), [2]);
        assert_eq!(spread_inside(8, 2), [2, 6]);
        assert_eq!(spread_inside(3, 9), [0, 1, 2]);
        assert_eq!((spread_inside(0, 2), spread_inside(2, 0)), (vec![], vec![]));
    }
}
