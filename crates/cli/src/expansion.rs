//! `atsplat expansion`: Adaptive Token Expansion over a protocol; and data of its plots in one trial.

use std::path::PathBuf;
use std::sync::Arc;

use anyhow::{Context as _, bail};
use atsplat_eval::expansion::{ExpansionReport, Subject, seen_by, study, survey};
use atsplat_eval::live::LiveScene;
use atsplat_eval::method::constants_of;
use atsplat_eval::runner::{Dataset, Selection};
use atsplat_model::network::Network;
use atsplat_protocol::EvaluationIndex;
use atsplat_protocol::trial::{DecodeAhead, Prefetch, TargetPictures, Trial, TrialRecipe, Trials};
use atsplat_report::figures::{ExpansionScene, ExpansionTarget};
use atsplat_scene::Warnings;
use atsplat_splat::{RenderOptions, View};

use crate::embedded;
use crate::model_args::ChangeArgs;
use crate::objects::RemoteData;
use crate::output::{print_report, print_warnings, warn};
use crate::progress::Progress;
use crate::run::protocols::ProtocolArgs;

/// Label of random weights in every plot of their expansion.
pub(crate) const UNTRAINED: &str = "UNTRAINED, random weights";

#[derive(Debug, clap::Args)]
#[command(override_usage = "atsplat expansion <PRESET|FILE>… --data <PATH> [OPTIONS]")]
pub(crate) struct Args {
    #[command(flatten)]
    protocols: ProtocolArgs,

    /// Weights with their configuration; by default those embedded in the binary.
    #[arg(long, value_name = "FILE")]
    weights: Option<PathBuf>,

    #[command(flatten)]
    changes: ChangeArgs,

    /// Only N scenes of each dataset, spread evenly over the index.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..))]
    limit: Option<u64>,

    /// Print JSON.
    #[arg(long)]
    json: bool,
}

/// Surveys a network under each protocol; `true` if no trial was skipped.
pub(crate) fn run(args: &Args) -> anyhow::Result<bool> {
    let trained = embedded::trained(args.weights.as_deref())?;
    let config = args.changes.applied(&trained.config)?;
    let network = trained.bare(&config)?;
    let mut warnings = Warnings::new();
    let mut complete = true;
    let remote = args.protocols.remote()?;
    for dataset in args.protocols.open(remote.as_ref(), &mut warnings)? {
        let index = Selection { limit: args.limit, shard: None }.index_of(&dataset);
        let trials = trials(&dataset, &index);
        let progress = Progress::new("trials", trials.size_hint().0);
        let mut surveys = Vec::new();
        for outcome in trials {
            match outcome {
                Ok((trial, truths)) => {
                    let surveyed = survey(&network, (&trial, &truths), render_options(&dataset, &trial), 0);
                    surveys.push(surveyed.with_context(|| format!("scene {}", trial.scene()))?);
                }
                Err(skipped) => {
                    warn(&skipped.to_string());
                    complete = false;
                }
            }
            progress.step();
        }
        drop(progress);
        RemoteData::check(remote.as_ref())?;
        if surveys.is_empty() {
            bail!("{}: none of its trials can be read", dataset.name);
        }
        print_report(&ExpansionReport::new(&config.name, &dataset.name, &surveys), args.json)?;
    }
    print_warnings(&warnings);
    Ok(complete)
}

/// The trials of an index, decoded when needed.
pub(crate) fn trials(dataset: &Dataset, index: &EvaluationIndex) -> Trials {
    let no_prefetch = Prefetch { trials: 0, decode: DecodeAhead::Nothing, max_bytes: 0 };
    Trials::new(Arc::clone(&dataset.source), index, TrialRecipe::of(&dataset.preset, "ATSplat"), no_prefetch)
}

/// How a protocol renders a trial.
pub(crate) fn render_options(dataset: &Dataset, trial: &Trial) -> RenderOptions {
    let renderer = &dataset.preset.renderer;
    RenderOptions {
        constants: constants_of(renderer, trial.near_far()),
        background: renderer.background,
        ..RenderOptions::default()
    }
}

/// Studies a trial under a network: the token families seen in the first context view, and at most `max_targets` targets; and its
/// Gaussians for a live view.
pub(crate) fn study_trial(
    network: &Network,
    (trial, truths): (&Trial, &TargetPictures),
    options: RenderOptions,
    call_seed: u64,
    max_targets: usize,
) -> anyhow::Result<(ExpansionScene, LiveScene)> {
    let positions = spread_inside(trial.targets().len(), max_targets);
    let subject = Subject::of(trial, truths, &positions, options, call_seed)?;
    let studied = study(network, &subject)?;
    let live = LiveScene::of(&studied.trace, trial, &subject.options);
    let first = trial.context().first().context("the trial has no context view")?;
    let view = View { camera: first.camera, size: first.size };
    let targets = subject.targets.into_iter().zip(studied.targets);
    let targets = targets.map(|(target, study)| ExpansionTarget { frame: target.frame, truth: target.truth, study });
    let scene = ExpansionScene {
        label: trial.scene().to_owned(),
        frame: first.frame,
        picture: first.picture()?,
        families: seen_by(&studied.families, &view)?,
        expanded: studied.families.len(),
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
