use atsplat_camera::Ray;
use atsplat_nn::layers::{Linear, Norm};
use atsplat_nn::ops::{gather_max, gelu, linear};
use burn::Tensor;
use burn::module::{Initializer, Module, Param};
use burn::tensor::{Device, Int, TensorData, activation};

use super::Views;
use super::layers::{Head, Maker};
use super::patch_frame::PatchFrames;
use crate::ModelError;
use crate::config::{AnchorContext, AnchorDesign, DepthActivation, Grid, HeadFrame, ModelConfig};
use crate::neighbours::nearest_neighbours;

/// What makes tokens of coarse features.
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

/// Tokens and where they are.
#[derive(Clone, Debug)]
pub struct Tokens {
    /// `[scenes, tokens, channels]`.
    pub features: Tensor<3>,
    /// Anchors in scene units, `[scenes, tokens, 3]`; none in designs without a place.
    pub anchors: Option<Tensor<3>>,
    /// Origins and unit directions of the rays of a token's Gaussians, each `[scenes, tokens, K · 3]`; in the design
    /// `ray-depth` alone.
    pub rays: Option<[Tensor<3>; 2]>,
    /// Depths along the anchors' rays, `[scenes, tokens]`; of the initial tokens of the design `patch-depth`.
    pub depths: Option<Tensor<2>>,
    /// Where `head.frame` is the patch's, what the Gaussians of each token are measured in.
    pub frames: Option<PatchFrames>,
}

impl Anchors {
    pub(super) fn new(config: &ModelConfig, make: Maker<'_>) -> Self {
        let dim = make.transformer.dim;
        let design = config.anchors.design;
        let tokens = match design {
            AnchorDesign::LearnableTokens { tokens } => {
                Some(Initializer::Normal { mean: 0.0, std: 0.02 }.init::<2, _>([tokens, dim], make.device))
            }
            _ => None,
        };
        let context = match config.anchors.context {
            AnchorContext::PointNet { neighbours } => Some(Context {
                norm: make.norm(),
                fc1: make.linear(dim + 3, dim),
                fc2: make.linear(dim, dim),
                neighbours,
            }),
            AnchorContext::None {} => None,
        };
        Self { depth: design.has_anchors().then(|| make.head(1)), tokens, context }
    }

    /// `coarse` is `[scenes, views · patches, channels]`, the grid that of a view.
    pub(super) fn forward(
        &self,
        config: &ModelConfig,
        scenes: &[Views],
        coarse: Tensor<3>,
        grid: Grid,
        device: &Device,
    ) -> Result<Tokens, ModelError> {
        let without_place = |features| Tokens { features, anchors: None, rays: None, depths: None, frames: None };
        match (config.anchors.design, &self.tokens, &self.depth) {
            (AnchorDesign::LearnableTokens { .. }, Some(tokens), _) => {
                Ok(without_place(tokens.val().unsqueeze::<3>().repeat_dim(0, scenes.len())))
            }
            (AnchorDesign::RayDepth {}, ..) => {
                let rays = cell_rays(scenes, grid, config.head.cells(), device)?;
                Ok(Tokens { rays: Some(rays), ..without_place(coarse) })
            }
            (AnchorDesign::PatchDepth {}, _, Some(head)) => {
                let depths = depth(config.anchors.depth, head.forward(coarse.clone()));
                let [origins, directions] = rays(scenes, grid, device)?;
                let anchors = origins + directions * depths.clone();
                let features = match &self.context {
                    Some(context) => context.forward(coarse, &anchors, device)?,
                    None => coarse,
                };
                let frames = (config.head.frame == HeadFrame::Patch)
                    .then(|| PatchFrames::new(scenes, grid, config.coarse.patch_size, &depths, device));
                Ok(Tokens {
                    anchors: Some(anchors),
                    depths: Some(depths.squeeze_dim(2)),
                    frames,
                    ..without_place(features)
                })
            }
            _ => Ok(without_place(coarse)),
        }
    }
}

impl Context {
    fn forward(&self, features: Tensor<3>, anchors: &Tensor<3>, device: &Device) -> Result<Tensor<3>, ModelError> {
        let [scenes, tokens, dim] = features.dims();
        let positions = anchors.clone().into_data_as::<f32>();
        let positions = positions.as_slice::<f32>().unwrap_or_default().as_chunks::<3>().0;
        let count = self.neighbours.min(tokens);
        let mut indices = Vec::with_capacity(scenes * tokens * count);
        for scene in positions.chunks_exact(tokens.max(1)) {
            indices.extend(nearest_neighbours(scene, count)?.indices.into_iter().map(i64::from));
        }
        let indices = Tensor::<3, Int>::from_data(TensorData::new(indices, [scenes, tokens, count]), device);
        // `fc1` over (feature of the neighbour, its anchor − own anchor) is a sum of three: what the neighbour gives
        // can be compared before what is the token's own is taken off.
        let weight = self.fc1.weight.val();
        let own = linear(anchors.clone(), weight.clone().slice_dim(0, dim..dim + 3), None);
        let bias = self.fc1.bias.as_ref().map(Param::val);
        let given = linear(self.norm.forward(features.clone()), weight.slice_dim(0, 0..dim), bias) + own.clone();
        let largest = gather_max(given, indices) - own;
        Ok(features + self.fc2.forward(gelu(largest)))
    }
}

/// Raw outputs as distances along unit rays.
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

/// Rays through the centres of a patch's cells, as many as a token has Gaussians; each `[scenes, tokens, K · 3]`.
fn cell_rays(scenes: &[Views], grid: Grid, cells: Grid, device: &Device) -> Result<[Tensor<3>; 2], ModelError> {
    let (count, Grid { rows, columns }) = (cells.len(), cells);
    let fine = Grid { rows: grid.rows * rows, columns: grid.columns * columns };
    let mut all = Vec::new();
    for views in scenes {
        let rays = views.rays(fine)?;
        for view in rays.chunks_exact(fine.len().max(1)) {
            for patch in 0..grid.len() {
                let (top, left) = (patch / grid.columns * rows, patch % grid.columns * columns);
                for cell in 0..count {
                    let at = (top + cell / columns) * fine.columns + left + cell % columns;
                    all.extend(view.get(at).copied());
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
    [tensor(|ray| ray.origin.to_array().map(f32_from_f64)), tensor(|ray| ray.direction.to_array().map(f32_from_f64))]
}

#[expect(clippy::cast_possible_truncation, reason = "the one rounding to the network's precision")]
fn f32_from_f64(value: f64) -> f32 {
    value as f32
}
