use std::sync::Arc;

use atsplat_camera::{Camera, ImageSize, NormalizedIntrinsics, WorldFromCamera};
use atsplat_model::ModelConfig;
use atsplat_model::budget::budget;
use atsplat_model::config::Selection;
use atsplat_model::network::{Device, Network};
use atsplat_model::parameters::parameters;
use atsplat_model::weights::generated;
use atsplat_numeric::{Extremes as _, Tolerance};
use atsplat_protocol::trial::{Prefetch, TargetImages, Trial, TrialRecipe, Trials};
use atsplat_protocol::{IndexFile, Preset};
use atsplat_splat::{RenderOptions, View};
use glam::{DMat3, DVec3};

use super::*;
use crate::sources::simulated;

/// A trial of a simulated room, 128×128 pixels.
pub(crate) fn trial() -> (Trial, TargetImages) {
    let preset = Preset::named("rooms-2v-128").unwrap();
    let mut index = IndexFile::embedded("rooms-2v").unwrap().unwrap().index;
    index.scenes.truncate(1);
    index.scenes.values_mut().flatten().for_each(|entry| entry.target.truncate(2));
    let source = Arc::new(simulated(&preset, &index).unwrap().unwrap());
    Trials::new(source, &index, TrialRecipe::of(&preset, "ATSplat"), Prefetch::NONE).next().unwrap().unwrap()
}

pub(crate) fn subject(positions: &[usize]) -> Subject {
    let (trial, truths) = trial();
    Subject::of(&trial, &truths, positions, RenderOptions::default(), 0).unwrap()
}

pub(crate) fn nano() -> ModelConfig {
    ModelConfig::named("nano").unwrap()
}

pub(crate) fn network(config: &ModelConfig) -> Network {
    let weights = generated(&parameters(config), 5);
    Network::new(config, &Device::flex()).unwrap().with_weights(&weights).unwrap()
}

#[test]
fn families_are_mean_centres_of_decoded_gaussians() {
    let (network, subject) = (network(&nano()), subject(&[]));
    let found = study(&network, &subject).unwrap();
    assert!(found.targets.is_empty());
    let reconstruction = network.reconstruct(&subject.views, 0).unwrap();
    let by_block = |block: usize| found.expanded_tokens.iter().filter(move |expanded| expanded.block == block);
    let counts: Vec<usize> = (1..=4).map(|block| by_block(block).count()).collect();
    assert_eq!(counts, reconstruction.budget.expanded);

    // The last block's children are final tokens, whose Gaussians have these mean centres.
    let centre = |gaussians: &Gaussians, token: usize| {
        let of_token = gaussians.parts().means.iter().enumerate().filter(|(at, _)| at / 16 == token);
        of_token.fold(DVec3::ZERO, |sum, (_, mean)| sum + DVec3::from(mean.map(f64::from)) / 16.0)
    };
    let tolerance = Tolerance::relative(1e-9);
    let first_child = reconstruction.budget.final_tokens - 2 * reconstruction.budget.expanded[3];
    for (at, expanded) in by_block(4).enumerate() {
        let expected = [0, 1].map(|child| centre(&reconstruction.gaussians, first_child + 2 * at + child).to_array());
        let children = expanded.children.iter().flat_map(DVec3::to_array);
        tolerance.assert(children.collect::<Vec<f64>>(), expected.concat(), "children");
        assert_ne!(expanded.children[0], expanded.children[1], "siblings share an anchor but not a centre");
    }
    // A parent is decoded as it enters its block.
    let forward = network.forward(std::slice::from_ref(&subject.views), 0).unwrap();
    let entering = network.gaussians(&forward.blocks[0].tokens).scene(0).unwrap();
    for (expanded, &token) in by_block(2).zip(&reconstruction.blocks[1].selected) {
        tolerance.assert(expanded.parent.to_array(), centre(&entering, token).to_array(), "parent");
        assert_eq!(expanded.score, reconstruction.blocks[1].scores.as_ref().map(|scores| scores[token]));
    }
}

#[test]
fn families_are_projected_to_pixels() {
    let pose = WorldFromCamera::new(DMat3::IDENTITY, DVec3::new(1.0, 0.0, 0.0)).unwrap();
    let camera = Camera::pinhole(pose.inverse(), NormalizedIntrinsics::new(0.5, 1.0, 0.5, 0.5).unwrap());
    let view = View { camera, size: ImageSize { width: 200, height: 100 } };
    let expanded = |parent: [f64; 3], children: &[[f64; 3]]| ExpandedToken {
        block: 2,
        score: None,
        parent: parent.into(),
        children: children.iter().map(|&child| child.into()).collect(),
    };
    let expanded_tokens = [
        expanded([1.0, 0.0, 4.0], &[[2.0, 0.4, 4.0], [1.0, 0.0, -4.0], [9.0, 0.0, 4.0]]),
        expanded([1.0, 0.0, -1.0], &[[1.0, 0.0, 4.0]]),
        expanded([9.0, 0.0, 4.0], &[[1.0, 0.0, 4.0]]),
    ];
    let seen = projected_tokens(&expanded_tokens, &view).unwrap();
    let [only] = &seen[..] else { panic!("{seen:?}") };
    Tolerance::absolute(1e-9).assert(only.parent, [100.0, 50.0], "the middle");
    let children = only.children.concat();
    Tolerance::absolute(1e-9).assert(children, [125.0, 60.0, 300.0, 50.0], "in front of the camera, inside or not");
}

#[test]
fn the_last_stage_is_the_full_render() {
    let (config, subject) = (nano(), subject(&[0, 1]));
    let network = network(&config);
    let found = study(&network, &subject).unwrap();
    let reconstruction = network.reconstruct(&subject.views, 0).unwrap();
    for (target, studied) in subject.targets.iter().zip(&found.targets) {
        let blocks: Vec<&[usize]> = studied.stages.iter().map(|stage| stage.blocks.as_slice()).collect();
        assert_eq!(blocks, [&[][..], &[2], &[2, 3], &[2, 3, 4]]);
        for (at, stage) in studied.stages.iter().enumerate() {
            let range = budget(&config.with_expansion_in_first(at), 2, subject.views.size()).unwrap();
            assert_eq!(stage.gaussians, range.fixed().unwrap().gaussians);
            assert!(stage.psnr.is_finite());
        }
        let whole = CpuRenderer::default().render(&reconstruction.gaussians, &target.view, &subject.options).unwrap();
        assert_eq!(studied.stages[3].image.samples(), whole.rgb.as_flattened());
        assert_ne!(studied.stages[0].image.samples(), whole.rgb.as_flattened());
        // Depth is a mean over what is drawn, so it is between the nearest and the farthest Gaussian.
        let pose = target.view.camera.camera_from_world;
        let means = reconstruction.gaussians.parts().means.iter();
        let depths: Vec<f64> =
            means.map(|mean| pose.transform_point(DVec3::from(mean.map(f64::from))).z).filter(|z| *z > 0.0).collect();
        let [nearest, farthest] =
            [f64::minimum_of, f64::maximum_of].map(|better| depths.iter().copied().reduce(better).unwrap());
        let (seen, unseen): (Vec<f64>, Vec<f64>) = studied.depth.iter().partition(|depth| **depth > 0.0);
        assert_eq!(seen.len() + unseen.len(), 128 * 128);
        assert!(seen.len() > unseen.len() && seen.iter().all(|z| (nearest * 0.999..farthest * 1.001).contains(z)));
    }
}

#[test]
fn uncertainty_is_composited_and_only_selected_tokens_are_opaque() {
    let (network, subject) = (network(&nano()), subject(&[0]));
    let found = study(&network, &subject).unwrap().targets.remove(0).uncertainty.unwrap();
    let trace = network.trace(&subject.views, 0).unwrap();
    let scores = trace.reconstruction.blocks[3].scores.as_ref().unwrap();
    assert_eq!((found.block, found.tokens, found.selected), (4, scores.len(), trace.reconstruction.budget.expanded[3]));
    assert_eq!(found.error.len(), 128 * 128);
    let whole = CpuRenderer::default().render(&trace.entering[3], &subject.targets[0].view, &subject.options).unwrap();
    let [least, most] = [f64::minimum_of, f64::maximum_of]
        .map(|better| scores.iter().map(|&score| f64::from(score)).reduce(better).unwrap());
    let slack = 1e-4;
    for ((predicted, selected), alpha) in found.predicted.iter().zip(&found.selected_alpha).zip(&whole.alpha) {
        let alpha = f64::from(*alpha);
        assert!((least * alpha - slack..=most * alpha + slack).contains(predicted), "{predicted} of {alpha}");
        // Compositing stops early at low transmittance, and sooner with more Gaussians.
        assert!((0.0..=alpha + 2e-3).contains(selected), "{selected} of {alpha}");
    }
    assert!(found.selected_alpha.iter().any(|alpha| *alpha > 0.1));
    assert!(found.error.iter().all(|error| (0.0..=2.0).contains(error)) && found.correlation.is_some());
}

#[test]
fn without_selected_tokens_nothing_is_opaque() {
    let config = nano().with_thresholds(&[1e9; 3]).unwrap();
    let found = study(&network(&config), &subject(&[0])).unwrap();
    assert!(found.expanded_tokens.is_empty());
    let uncertainty = found.targets[0].uncertainty.as_ref().unwrap();
    assert_eq!(uncertainty.selected, 0);
    assert!(uncertainty.selected_alpha.iter().all(|alpha| alpha.abs().to_bits() == 0));
}

#[test]
fn studies_without_scores_or_expansion_are_partial() {
    let mut random = nano();
    random.expansion.selection = Selection::Random { seed: 1 };
    let found = study(&network(&random), &subject(&[0])).unwrap();
    assert!(found.targets[0].uncertainty.is_none() && !found.expanded_tokens.is_empty());
    assert_eq!(found.targets[0].stages.len(), 4);

    // Only the second expanding block: the first one stays disabled in every stage.
    let mut second = nano().with_expansion_in_first(2);
    second.decoder.blocks[1].expand = false;
    let found = study(&network(&second), &subject(&[0])).unwrap();
    let blocks: Vec<&[usize]> = found.targets[0].stages.iter().map(|stage| stage.blocks.as_slice()).collect();
    assert_eq!(blocks, [&[][..], &[3]]);

    let found = study(&network(&nano().with_expansion_in_first(0)), &subject(&[0])).unwrap();
    assert!(found.expanded_tokens.is_empty() && found.targets[0].stages.len() == 1);
    assert!(found.targets[0].uncertainty.is_none());
}

#[test]
fn invalid_subjects_are_errors() {
    let (trial, truths) = trial();
    let message = Subject::of(&trial, &truths, &[9], RenderOptions::default(), 0).unwrap_err().to_string();
    assert_eq!(message, "target: expected one of 2, found 9");
    let mut subject = subject(&[0]);
    subject.targets[0].view.size = ImageSize { width: 64, height: 64 };
    assert!(matches!(study(&network(&nano()), &subject), Err(ExpansionError::Metric(_))));
    let config = nano();
    let mut weights = generated(&parameters(&config), 5);
    let (_, head) = weights.tensors.iter_mut().find(|(name, _)| name.starts_with("head.")).unwrap();
    let huge = vec![f32::MAX; head.shape().iter().product()];
    *head = atsplat_model::weights::StoredTensor::from_f32(head.shape().to_vec(), &huge).unwrap();
    let broken = Network::new(&config, &Device::flex()).unwrap().with_weights(&weights).unwrap();
    assert!(matches!(study(&broken, &subject), Err(ExpansionError::Model(_))));
}
