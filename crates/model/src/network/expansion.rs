use atsplat_nn::f32_values;
use atsplat_nn::layers::Linear;
use atsplat_nn::ops::gather_rows;
use burn::Tensor;
use burn::module::Module;
use burn::tensor::{Device, Int, TensorData, activation};

use super::Tokens;
use super::layers::{Head, LayerBuilder};
use crate::ModelError;
use crate::config::{BlockExpansion, ExpansionConfig, ModelConfig, Scoring, Selection, SelectionRatio};
use crate::farthest_point::farthest_points;
use crate::selection;

/// Adaptive Token Expansion of one block.
#[derive(Module, Debug)]
pub(super) struct Expansion {
    score: Option<Head>,
    children: Linear,
}

/// Expansion of one block, for each scene.
#[derive(Clone, Debug)]
pub struct Expanded {
    /// Predicted uncertainty of the tokens that entered, `[scenes, tokens]`; only for selections by score.
    pub scores: Option<Tensor<2>>,
    /// Indices of the tokens that were expanded, ascending; by scene.
    pub selected: Vec<Vec<usize>>,
    /// For each token that left, the index of its parent, or of itself if it was not expanded; by scene.
    pub parents: Vec<Vec<usize>>,
}

impl Expansion {
    pub(super) fn new(config: &ModelConfig, builder: LayerBuilder<'_>) -> Self {
        let scored = config.expansion.selection.is_scored();
        let dim = builder.transformer.dim;
        Self { score: scored.then(|| builder.head(1)), children: builder.linear(dim, config.expansion.children * dim) }
    }

    /// Predicted uncertainty, `[scenes, tokens]`: softplus of a head on the detached tokens, or on the tokens themselves for
    /// the straight-through estimator.
    pub(super) fn scores(&self, features: &Tensor<3>, scoring: Scoring) -> Option<Tensor<2>> {
        let head = self.score.as_ref()?;
        let features = match scoring {
            Scoring::None => return None,
            Scoring::Detached => features.clone().detach(),
            Scoring::StraightThrough => features.clone(),
        };
        Some(activation::softplus(head.forward(features), 1.0).squeeze_dim(2))
    }

    /// Expands tokens; `block` counts from 0. It and the call's seed are keys of random selection.
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
        let scoring = config.selection.scoring();
        let scores = self.scores(&tokens.features, scoring);
        let mut selected = Vec::with_capacity(scenes);
        let score_values = scores.clone().map(f32_values);
        let anchors = tokens.place.anchors().filter(|_| config.selection.needs_anchors());
        let anchor_values = anchors.cloned().map(f32_values);
        for scene in 0..scenes {
            // Empty for selections that need none.
            let of_scene = |all: &'_ Option<Vec<f32>>, length: usize| {
                all.as_ref().map(|all| all[scene * length..(scene + 1) * length].to_vec()).unwrap_or_default()
            };
            let (scores, anchors) = (of_scene(&score_values, count), of_scene(&anchor_values, 3 * count));
            let of_tokens = |ratio: SelectionRatio| ratio.of(count, config.ratio_rounding);
            selected.push(match (config.selection, how_many) {
                (Selection::Random { seed }, BlockExpansion::Ratio(ratio)) => {
                    let keys = [seed, call_seed.wrapping_add(scene as u64), block as u64];
                    selection::random(count, of_tokens(ratio), &keys)
                }
                (Selection::FarthestPoint {}, BlockExpansion::Ratio(ratio)) => {
                    farthest_points(anchors.as_chunks().0, of_tokens(ratio))?
                }
                (Selection::Uncertainty {} | Selection::StraightThrough {}, BlockExpansion::Ratio(ratio)) => {
                    selection::highest(&scores, of_tokens(ratio))?
                }
                // Configurations with thresholds have a selection by score.
                (_, BlockExpansion::Threshold(threshold)) => selection::above(&scores, threshold)?,
            });
        }
        let parents: Vec<Vec<usize>> =
            selected.iter().map(|selected| selection::parents(count, selected, config.children)).collect();
        let first = selected.first().map_or(0, Vec::len);
        if selected.iter().any(|selected| selected.len() != first) {
            let expected = "one scene at a time, because thresholds select different numbers of tokens";
            return Err(ModelError::malformed("network", "scenes", expected, scenes));
        }
        let multiplied = match scoring {
            Scoring::None | Scoring::Detached => None,
            Scoring::StraightThrough => scores.clone(),
        };
        let expanded = self.expand(config.children, tokens, &selected, &parents, multiplied, device);
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
        let inherited = |x: Tensor<3>| gather_rows(x, origins.clone());
        let all = inherited(tokens.features.clone());
        let [_, after, _] = all.dims();
        let unselected = after - chosen * children;
        let chosen_features = gather_rows(tokens.features.clone(), indices(selected, device));
        let residuals = self.children.forward(chosen_features).reshape([scenes, chosen * children, dim]);
        let mut children = all.clone().slice_dim(1, unselected..after) + residuals;
        if let Some(scores) = straight_through {
            let inherited_scores = inherited(scores.unsqueeze_dim(2)).slice_dim(1, unselected..after);
            children = children * (inherited_scores.clone() - inherited_scores.detach() + 1.0);
        }
        let features =
            if unselected == 0 { children } else { Tensor::cat(vec![all.slice_dim(1, 0..unselected), children], 1) };
        Tokens { features, place: tokens.place.inherited(inherited) }
    }
}

fn indices(rows: &[Vec<usize>], device: &Device) -> Tensor<2, Int> {
    let width = rows.first().map_or(0, Vec::len);
    let flat: Vec<i64> = rows.iter().flatten().map(|&index| index.cast_signed() as i64).collect();
    Tensor::from_data(TensorData::new(flat, [rows.len(), width]), device)
}
