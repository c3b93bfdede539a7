//! Random selection of a block, and gradients of its scores.

use super::tests::{base, numbers, straight_through};
use super::*;
use crate::config::Selection;
use crate::hash::Stream;
use crate::parameters::parameters;
use crate::weights::generated;
use atsplat_numeric::Tolerance;
use burn::tensor::TensorData;

/// Numbers in [−1, 1), a function of the name.
fn noise(name: &str, shape: [usize; 3], device: &Device) -> Tensor<3> {
    let stream = Stream::named(5, name);
    let count = shape.iter().product::<usize>() as u64;
    #[expect(clippy::cast_possible_truncation, reason = "tensors are f32")]
    let values: Vec<f32> = (0..count).map(|at| stream.signed_unit(at) as f32).collect();
    Tensor::from_data(TensorData::new(values, shape), device)
}

/// A straight-through estimator does not change values, and the loss has a gradient with respect to the score of each
/// selected token: `∂L/∂s = Σ g · child` over its children, with `g` the gradient with respect to the child.
///
/// The score is `softplus(z)` and `z` is linear in the head's last layer `w`, so `w · ∂L/∂w = Σ ∂L/∂s · σ(z) · z`.
#[test]
fn straight_through_scores_get_their_childrens_gradient() {
    let device = Device::flex().autodiff();
    let fixture = straight_through();
    let network = fixture.network(&device);
    let config = &fixture.config;
    assert_eq!(config.expansion.selection, Selection::StraightThrough {});
    let (count, dim) = (24, config.transformer.dim);
    for (position, block) in config.decoder.blocks.iter().enumerate() {
        let Some(how_many) = block.expansion else { continue };
        let expansion = network.decoder.blocks[position].expansion.as_ref().unwrap();
        let features = noise(&format!("tokens {position}"), [1, count, dim], &device);
        let tokens = Tokens { features, place: Place::Free };
        let (after, expanded) = expansion.forward(&config.expansion, how_many, tokens, position, 0, &device).unwrap();
        let [_, left, _] = after.features.dims();
        let weights = noise(&format!("pull {position}"), [1, left, dim], &device);
        let gradients = network.gradients(&(after.features.clone() * weights.clone()).sum().backward());

        let (values, child_gradients) = (numbers(after.features), numbers(weights));
        let scores = numbers(expanded.scores.unwrap());
        let chosen = &expanded.selected[0];
        let unselected = count - chosen.len();
        let mut expected = 0.0;
        for (order, token) in chosen.iter().enumerate() {
            let children = (unselected + order * config.expansion.children) * dim;
            let of_children = children..children + config.expansion.children * dim;
            let of_score: f64 = of_children.map(|at| child_gradients[at] * values[at]).sum();
            let z = scores[*token].exp_m1().ln();
            expected += of_score * z / (1.0 + (-z).exp());
        }
        assert!(expected.abs() > 1e-2, "block {position}: the gradient is too small for a test: {expected}");
        let weights = network.weights().unwrap();
        let last = gradients.iter().filter(|(name, _)| name.contains("expansion.score.mlp.fc2"));
        let found: f64 = last
            .map(|(name, gradient)| {
                let weights = weights.tensors[name].to_f32().unwrap();
                weights.iter().zip(gradient).map(|(w, g)| f64::from(*w) * f64::from(*g)).sum::<f64>()
            })
            .sum();
        Tolerance { absolute: 1e-5, relative: 1e-4 }.assert([found], [expected], &format!("block {position}"));
    }
}

/// Two scenes of one batch draw differently, each as it would alone: the second scene with the next call seed.
#[test]
fn random_selection_differs_between_scenes() {
    let device = Device::flex();
    let fixture = base();
    let mut config = fixture.config.clone();
    config.expansion.selection = Selection::Random { seed: 3 };
    let weights = generated(&parameters(&config), fixture.seed);
    let network = Network::new(&config, &device).unwrap().with_weights(&weights).unwrap();
    let chosen = |scenes: &[Views], call_seed| -> Vec<Vec<Vec<usize>>> {
        let made = network.forward(scenes, call_seed).unwrap();
        made.blocks.into_iter().filter_map(|block| Some(block.expanded?.selected)).collect()
    };
    let views = fixture.views();
    let both = chosen(&[views.clone(), views.clone()], 7);
    let [first, second] = [7, 8].map(|seed| chosen(std::slice::from_ref(&views), seed));
    assert!(!both.is_empty());
    for ((both, first), second) in both.iter().zip(first).zip(second) {
        assert!(!both[0].is_empty());
        assert_ne!(both[0], both[1], "scenes of one batch");
        assert_eq!((&both[0], &both[1]), (&first[0], &second[0]));
    }
}
