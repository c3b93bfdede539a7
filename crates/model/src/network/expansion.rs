use atsplat_nn::layers::Linear;
use atsplat_nn::ops::gather_rows;
use burn::Tensor;
use burn::module::Module;
use burn::tensor::{Device, Int, TensorData, activation};

use super::anchors::Tokens;
use super::layers::{Head, Maker};
use crate::ModelError;
use crate::config::{BlockExpansion, ExpansionConfig, ModelConfig, Selection};
use crate::farthest_point::farthest_points;
use crate::selection;

/// Adaptive Token Expansion of one block.
#[derive(Module, Debug)]
pub(super) struct Expansion {
    score: Option<Head>,
    children: Linear,
}

/// What one block did to the tokens of each scene.
#[derive(Clone, Debug)]
pub struct Expanded {
    /// Predicted uncertainty of the tokens that entered, `[scenes, tokens]`; with selections that score.
    pub scores: Option<Tensor<2>>,
    /// Indices of the tokens that were expanded, ascending; by scene.
    pub selected: Vec<Vec<usize>>,
    /// Of each token that left, the index of the one that it is or came from; by scene.
    pub parents: Vec<Vec<usize>>,
}

impl Expansion {
    pub(super) fn new(config: &ModelConfig, make: Maker<'_>) -> Self {
        let scored = matches!(config.expansion.selection, Selection::Uncertainty {} | Selection::StraightThrough {});
        let dim = make.transformer.dim;
        Self { score: scored.then(|| make.head(1)), children: make.linear(dim, config.expansion.children * dim) }
    }

    /// Predicted uncertainty, `[scenes, tokens]`: softplus of a head that sees the tokens without their history, or, with
    /// a straight-through estimator, with it.
    pub(super) fn scores(&self, features: &Tensor<3>, detached: bool) -> Option<Tensor<2>> {
        let head = self.score.as_ref()?;
        let features = if detached { features.clone().detach() } else { features.clone() };
        Some(activation::softplus(head.forward(features), 1.0).squeeze_dim(2))
    }

    /// `block` counts from 0; it and the call's seed decide what random selection draws.
    pub(super) fn forward(
        &self,
        config: &ExpansionConfig,
        how_many: BlockExpansion,
        tokens: Tokens,
        block: usize,
        call_seed: u64,
        device: &Device,
    ) -> Result<(Tokens, Expanded), ModelError> {
        let [scenes, count, _] = tokens.features.dims();
        let straight_through = config.selection == Selection::StraightThrough {};
        let scores = self.scores(&tokens.features, !straight_through);
        let mut selected = Vec::with_capacity(scenes);
        let (score_values, anchor_values) = (scores.clone().map(values), tokens.anchors.clone().map(values));
        for scene in 0..scenes {
            let scores = score_values.as_deref().and_then(|all| all.chunks_exact(count).nth(scene)).unwrap_or_default();
            let anchors =
                anchor_values.as_deref().and_then(|all| all.chunks_exact(3 * count).nth(scene)).unwrap_or_default();
            selected.push(match (config.selection, how_many) {
                (Selection::Random { seed }, BlockExpansion::Ratio(ratio)) => {
                    let keys = [seed, call_seed.wrapping_add(scene as u64), block as u64];
                    selection::random(count, ratio.of(count, config.ratio_rounding), &keys)
                }
                (Selection::FarthestPoint {}, BlockExpansion::Ratio(ratio)) => {
                    farthest_points(anchors.as_chunks().0, ratio.of(count, config.ratio_rounding))?
                }
                (_, BlockExpansion::Ratio(ratio)) => {
                    selection::highest(scores, ratio.of(count, config.ratio_rounding))?
                }
                (_, BlockExpansion::Threshold(threshold)) => selection::above(scores, threshold)?,
            });
        }
        let parents: Vec<Vec<usize>> =
            selected.iter().map(|selected| selection::parents(count, selected, config.children)).collect();
        let first = selected.first().map_or(0, Vec::len);
        if selected.iter().any(|selected| selected.len() != first) {
            let expected = "one scene at a time, because thresholds select different numbers of tokens";
            return Err(ModelError::malformed("network", "scenes", expected, scenes));
        }
        let expanded = self.expand(
            config.children,
            tokens,
            &selected,
            &parents,
            straight_through.then_some(scores.clone()).flatten(),
            device,
        );
        Ok((expanded, Expanded { scores, selected, parents }))
    }

    fn expand(
        &self,
        children: usize,
        tokens: Tokens,
        selected: &[Vec<usize>],
        parents: &[Vec<usize>],
        straight_through: Option<Tensor<2>>,
        device: &Device,
    ) -> Tokens {
        let chosen = selected.first().map_or(0, Vec::len);
        if chosen == 0 {
            return tokens;
        }
        let [scenes, _, dim] = tokens.features.dims();
        let origins = indices(parents, device);
        let carried = |x: Tensor<3>| gather_rows(x, origins.clone());
        let all = carried(tokens.features.clone());
        let [_, after, _] = all.dims();
        let unselected = after - chosen * children;
        let chosen_features = gather_rows(tokens.features.clone(), indices(selected, device));
        let residuals = self.children.forward(chosen_features).reshape([scenes, chosen * children, dim]);
        let mut born = all.clone().slice_dim(1, unselected..after) + residuals;
        if let Some(scores) = straight_through {
            let own = carried(scores.unsqueeze_dim(2)).slice_dim(1, unselected..after);
            born = born * (own.clone() - own.detach() + 1.0);
        }
        let features = if unselected == 0 { born } else { Tensor::cat(vec![all.slice_dim(1, 0..unselected), born], 1) };
        Tokens {
            features,
            anchors: tokens.anchors.map(&carried),
            rays: tokens.rays.map(|rays| rays.map(&carried)),
            depths: tokens.depths.map(|depths| carried(depths.unsqueeze_dim(2)).squeeze_dim(2)),
            frames: tokens.frames.map(|frames| frames.map(carried)),
        }
    }
}

fn values<const D: usize>(tensor: Tensor<D>) -> Vec<f32> {
    tensor.into_data_as::<f32>().as_slice::<f32>().unwrap_or_default().to_vec()
}

fn indices(rows: &[Vec<usize>], device: &Device) -> Tensor<2, Int> {
    let width = rows.first().map_or(0, Vec::len);
    let flat: Vec<i64> = rows.iter().flatten().map(|&index| index.cast_signed() as i64).collect();
    Tensor::from_data(TensorData::new(flat, [rows.len(), width]), device)
}
