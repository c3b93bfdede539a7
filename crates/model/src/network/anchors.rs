use atsplat_camera::Ray;
use atsplat_nn::layers::{Linear, Norm};
use atsplat_nn::ops::{gather_max, gelu, linear};
use atsplat_nn::{MatmulPrecision, f32_values};
use atsplat_numeric::narrowed;
use burn::Tensor;
use burn::module::{Initializer, Module, Param};
use burn::tensor::{Device, Int, TensorData, activation};

use super::layers::{Head, LayerBuilder};
use super::patch_frame::PatchFrames;
use super::{Place, Tokens, Views};
use crate::ModelError;
use crate::config::{AnchorContext, AnchorDesign, DepthActivation, Grid, HeadConfig, HeadFrame, ModelConfig};
use crate::neighbours::nearest_neighbours;

/// Predicts anchors and initial tokens from coarse features.
#[derive(Module, Debug)]
pub(super) struct Anchors {
    depth: Option<Head>,
    tokens: Option<Param<Tensor<2>>>,
    context: Option<Context>,
}

/// PointNet over the nearest anchors.
#[derive(Module, Debug)]
struct Context {
    norm: Norm,
    fc1: Linear,
    fc2: Linear,
    #[module(skip)]
    neighbours: usize,
}

impl Anchors {
    pub(super) fn new(config: &ModelConfig, builder: LayerBuilder<'_>) -> Self {
        let dim = builder.transformer.dim;
        let design = config.anchors.design;
        let tokens = match design {
            AnchorDesign::LearnableTokens { tokens } => {
                Some(Initializer::Normal { mean: 0.0, std: 0.02 }.init::<2, _>([tokens, dim], builder.device))
            }
            AnchorDesign::PatchDepth {} | AnchorDesign::RayDepth {} | AnchorDesign::DirectXyz {} => None,
        };
        let context = match config.anchors.context {
            AnchorContext::PointNet { neighbours } => Some(Context {
                norm: builder.norm(),
                fc1: builder.linear(dim + 3, dim),
                fc2: builder.linear(dim, dim),
                neighbours,
            }),
            AnchorContext::None {} => None,
        };
        Self { depth: design.has_anchors().then(|| builder.head(1)), tokens, context }
    }

    /// The initial tokens; `coarse` is `[scenes, views · patches, channels]`, `grid` that of one view.
    #[expect(clippy::expect_used, reason = "a network has the parameters of its configuration's design")]
    pub(super) fn forward(
        &self,
        config: &ModelConfig,
        scenes: &[Views],
        coarse: Tensor<3>,
        grid: Grid,
        device: &Device,
    ) -> Result<Tokens, ModelError> {
        let (features, place) = match config.anchors.design {
            AnchorDesign::PatchDepth {} => {
                let head = self.depth.as_ref().expect("a depth head in a design with anchors");
                let depths = depth(config.anchors.depth, head.forward(coarse.clone()));
                let [origins, directions] = rays(scenes, grid, device)?;
                let anchors = origins + directions * depths.clone();
                let features = match &self.context {
                    Some(context) => context.forward(coarse, &anchors, device)?,
                    None => coarse,
                };
                let frames = (config.head.frame == HeadFrame::Patch)
                    .then(|| Box::new(PatchFrames::new(scenes, grid, config.coarse.patch_size, &depths, device)));
                (features, Place::Anchored { anchors, depths: depths.squeeze_dim(2), frames })
            }
            AnchorDesign::RayDepth {} => (coarse, Place::Rays(cell_rays(scenes, grid, &config.head, device)?)),
            AnchorDesign::LearnableTokens { .. } => {
                let tokens = self.tokens.as_ref().expect("tokens in a design that learns them");
                (tokens.val().unsqueeze::<3>().repeat_dim(0, scenes.len()), Place::Free)
            }
            AnchorDesign::DirectXyz {} => (coarse, Place::Free),
        };
        Ok(Tokens { features, place })
    }
}

impl Context {
    fn forward(&self, features: Tensor<3>, anchors: &Tensor<3>, device: &Device) -> Result<Tensor<3>, ModelError> {
        let [scenes, tokens, dim] = features.dims();
        let positions = f32_values(anchors.clone());
        let positions = positions.as_chunks::<3>().0;
        let count = self.neighbours.min(tokens);
        let mut indices = Vec::with_capacity(scenes * tokens * count);
        for scene in positions.chunks_exact(tokens.max(1)) {
            indices.extend(nearest_neighbours(scene, count)?.indices.into_iter().map(i64::from));
        }
        let indices = Tensor::<3, Int>::from_data(TensorData::new(indices, [scenes, tokens, count]), device);
        // `fc1` of (neighbour's feature, its anchor − the token's anchor) is a sum of three terms: the maximum is taken over the
        // neighbour's terms before the token's term is subtracted.
        let weight = self.fc1.weight.val();
        // Positions are large and their differences small: these would be lost in the rounding of lower precisions, here and in the
        // gradient of the weight, which is a sum over positions.
        let of_position = weight.clone().slice_dim(0, dim..dim + 3);
        let of_token = MatmulPrecision::F32.scope(|| linear(anchors.clone(), of_position, None));
        let bias = self.fc1.bias.as_ref().map(Param::val);
        let neighbours =
            linear(self.norm.forward(features.clone()), weight.slice_dim(0, 0..dim), bias) + of_token.clone();
        let largest = gather_max(neighbours, indices) - of_token;
        Ok(features + self.fc2.forward(gelu(largest)))
    }
}

/// Applies the depth activation to raw outputs.
pub(super) fn depth<const D: usize>(rule: DepthActivation, x: Tensor<D>) -> Tensor<D> {
    match rule {
        DepthActivation::LogSigmoid { near, far, shift } => {
            (activation::sigmoid(x + shift) * (far / near).ln() + near.ln()).exp()
        }
        DepthActivation::Sigmoid { near, far, shift } => activation::sigmoid(x + shift) * (far - near) + near,
        DepthActivation::InverseSigmoid { near, far, shift } => {
            (activation::sigmoid(x + shift) * (near.recip() - far.recip()) + far.recip()).recip()
        }
        DepthActivation::Exp { shift } => (x + shift).exp(),
    }
}

/// Rays through the centres of the patches, origins and directions each `[scenes, views · patches, 3]`.
fn rays(scenes: &[Views], grid: Grid, device: &Device) -> Result<[Tensor<3>; 2], ModelError> {
    let mut all = Vec::new();
    for views in scenes {
        all.extend(views.rays(grid)?);
    }
    Ok(tensors(&all, scenes.len(), 3, device))
}

/// Rays through the centres of a patch's cells, one per Gaussian of a token; origins and directions each
/// `[scenes, tokens, K · 3]`.
fn cell_rays(scenes: &[Views], grid: Grid, head: &HeadConfig, device: &Device) -> Result<[Tensor<3>; 2], ModelError> {
    let (count, Grid { rows, columns }) = (head.gaussians_per_token, head.cells());
    let fine = Grid { rows: grid.rows * rows, columns: grid.columns * columns };
    let mut all = Vec::new();
    for views in scenes {
        let rays = views.rays(fine)?;
        for view in rays.chunks_exact(fine.len().max(1)) {
            for patch in 0..grid.len() {
                let (top, left) = (patch / grid.columns * rows, patch % grid.columns * columns);
                for cell in 0..count {
                    let at = (top + cell / columns) * fine.columns + left + cell % columns;
                    all.push(view[at]);
                }
            }
        }
    }
    Ok(tensors(&all, scenes.len(), 3 * count, device))
}

fn tensors(rays: &[Ray], scenes: usize, width: usize, device: &Device) -> [Tensor<3>; 2] {
    let tensor = |part: fn(&Ray) -> [f32; 3]| {
        let values: Vec<f32> = rays.iter().flat_map(part).collect();
        let tokens = values.len() / (scenes * width).max(1);
        Tensor::from_data(TensorData::new(values, [scenes, tokens, width]), device)
    };
    [tensor(|ray| ray.origin.to_array().map(narrowed)), tensor(|ray| ray.direction.to_array().map(narrowed))]
}

#[cfg(test)]
mod tests {
    use atsplat_numeric::{SplitMix64, Tolerance};

    use super::*;

    /// The context of a token comes from offsets between anchors, which do not change if the whole scene is moved; nor does the
    /// gradient of their weights. In bfloat16, positions near 50 are a quarter apart.
    #[test]
    fn offsets_between_anchors_keep_their_precision_far_from_the_origin() {
        let device = &Device::flex().autodiff();
        let config = ModelConfig::named("nano").unwrap();
        let anchors = Anchors::new(&config, LayerBuilder { transformer: &config.transformer, device });
        let (context, tokens, dim) = (anchors.context.unwrap(), 40, config.transformer.dim);
        let mut random = SplitMix64::new(5);
        let mut uniform = |width: usize| {
            let values: Vec<f32> = (0..width * tokens).map(|_| (random.next_u64() % 1000) as f32 / 1000.0).collect();
            Tensor::<3>::from_data(TensorData::new(values, [1, tokens, width]), device)
        };
        let (positions, slopes) = (uniform(3), uniform(dim));
        let of = |anchors: Tensor<3>| {
            let features = Tensor::zeros([1, tokens, dim], device);
            let (out, gradients) = MatmulPrecision::Bf16.scope(|| {
                let out = context.forward(features, &anchors, device).unwrap();
                (out.clone(), (out * slopes.clone()).sum().backward())
            });
            let by_weight = context.fc1.weight.val().grad(&gradients).unwrap();
            [f32_values(out), f32_values(by_weight.slice_dim(0, dim..dim + 3))]
                .map(|values| values.into_iter().map(f64::from).collect::<Vec<_>>())
        };
        let ([near, near_gradient], [far, far_gradient]) = (of(positions.clone()), of(positions + 50.0));
        let range = near.iter().fold(0.0, |most: f64, value| if value.abs() > most { value.abs() } else { most });
        assert!(range > 0.0);
        Tolerance::absolute(0.01 * range).assert(far, near, "a scene moved by 50");
        let moved: f64 = near_gradient.iter().zip(far_gradient).map(|(near, far)| (near - far).powi(2)).sum();
        let all: f64 = near_gradient.iter().map(|value| value * value).sum();
        let relative = (moved / all).sqrt();
        assert!(relative < 0.05, "the gradient of the weights of positions changes by {relative}");
    }
}
