use atsplat_nn::layers::{Block, Linear};
use burn::Tensor;
use burn::module::Module;
use burn::tensor::Device;

use super::dinov2::Dino;
use super::layers::LayerBuilder;
use super::patches::BranchInput;
use crate::ModelError;
use crate::config::{BackboneConfig, DinoArchitecture, Grid, ModelConfig};

/// The per-view network of coarse patch features; exactly one of the two is present.
#[derive(Module, Debug)]
pub(super) struct Backbone {
    dino: Option<Dino>,
    patch: Option<PatchBackbone>,
}

/// A linear layer over patches, and per-view layers.
#[derive(Module, Debug)]
struct PatchBackbone {
    embed: Linear,
    layers: Vec<Block>,
}

impl Backbone {
    pub(super) fn new(config: &ModelConfig, builder: LayerBuilder<'_>) -> Self {
        let patch = config.coarse.patch_size.pow(2);
        match config.backbone {
            BackboneConfig::DinoV2 { size, registers } => Self {
                dino: Some(Dino::new(DinoArchitecture::new(size, registers), builder.device).no_grad()),
                patch: None,
            },
            BackboneConfig::Patch { layers } => {
                let embed = builder.linear(patch * 9, builder.transformer.dim);
                Self { dino: None, patch: Some(PatchBackbone { embed, layers: builder.blocks(layers) }) }
            }
        }
    }

    /// `[views, patches, channels]`.
    pub(super) fn forward(
        &self,
        input: &BranchInput<'_>,
        patch_size: usize,
        grid: Grid,
        device: &Device,
    ) -> Result<Tensor<3>, ModelError> {
        match (&self.dino, &self.patch) {
            (Some(dino), _) => {
                let views = input.views;
                let cached = views.features([views.len(), grid.len(), dino.dim()], device);
                cached.unwrap_or_else(|| Ok(dino.forward(views, grid, device)))
            }
            (None, Some(patch)) => {
                let x = patch.embed.forward(input.colours_and_plucker(patch_size, device));
                Ok(patch.layers.iter().fold(x, |x, layer| layer.forward(x)))
            }
            (None, None) => Err(ModelError::malformed("network", "backbone", "one", "none")),
        }
    }
}

/// The coarse branch.
#[derive(Module, Debug)]
pub(super) struct Coarse {
    patch: Linear,
    fuse: Linear,
    plucker: Linear,
    layers: Vec<Block>,
}

/// Stages of the coarse branch, each `[scenes, views · patches, channels]`.
#[derive(Clone, Debug)]
pub struct CoarseStages {
    /// The backbone's features.
    pub backbone: Tensor<3>,
    /// After mixing with raw patches and adding the Plücker embedding.
    pub tokens: Tensor<3>,
    /// After attention across views.
    pub features: Tensor<3>,
}

impl Coarse {
    pub(super) fn new(config: &ModelConfig, builder: LayerBuilder<'_>) -> Self {
        let (patch, dim) = (config.coarse.patch_size.pow(2), builder.transformer.dim);
        Self {
            patch: builder.linear(patch * 3, dim),
            fuse: builder.linear(config.backbone.dim(dim) + dim, dim),
            plucker: builder.linear(patch * 6, dim),
            layers: builder.blocks(config.coarse.layers),
        }
    }

    /// `scenes` have the same number of views of the same size.
    pub(super) fn forward(
        &self,
        backbone: &Backbone,
        scenes: &[BranchInput<'_>],
        patch_size: usize,
        grid: Grid,
        device: &Device,
    ) -> Result<CoarseStages, ModelError> {
        let (mut features, mut tokens) = (Vec::new(), Vec::new());
        for scene in scenes {
            let of_backbone = backbone.forward(scene, patch_size, grid, device)?;
            let raw = self.patch.forward(scene.colours(patch_size, device));
            let mixed = self.fuse.forward(Tensor::cat(vec![of_backbone.clone(), raw], 2));
            let placed = mixed + self.plucker.forward(scene.plucker(patch_size, device));
            features.push(flattened(of_backbone));
            tokens.push(flattened(placed));
        }
        let (backbone, tokens) = (Tensor::cat(features, 0), Tensor::cat(tokens, 0));
        let features = self.layers.iter().fold(tokens.clone(), |x, layer| layer.forward(x));
        Ok(CoarseStages { backbone, tokens, features })
    }
}

/// `[views, patches, channels]` to `[1, views · patches, channels]`.
pub(super) fn flattened(x: Tensor<3>) -> Tensor<3> {
    let [views, patches, channels] = x.dims();
    x.reshape([1, views * patches, channels])
}
