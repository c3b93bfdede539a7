use atsplat_nn::f32_values;
use atsplat_nn::layers::{AttentionConfig, Block, BlockConfig, Linear, LinearConfig, Norm, NormConfig};
use burn::Tensor;
use burn::module::{Initializer, Module, Param};
use burn::tensor::{Device, TensorData};

use super::Views;
use super::bicubic::resized_grid;
use crate::ImageSize;
use crate::config::{DinoArchitecture, Grid};

/// Mean and standard deviation of ImageNet.
const MEAN: [f32; 3] = [0.485, 0.456, 0.406];
const DEVIATION: [f32; 3] = [0.229, 0.224, 0.225];

/// A DINOv2 vision transformer; never trained.
#[derive(Module, Debug)]
pub(super) struct Dino {
    cls_token: Param<Tensor<3>>,
    pos_embed: Param<Tensor<3>>,
    register_tokens: Option<Param<Tensor<3>>>,
    patch_embed: PatchEmbed,
    blocks: Vec<Block>,
    norm: Norm,
    #[module(skip)]
    architecture: DinoArchitecture,
}

/// A convolution whose stride is its kernel's size, as a linear layer over patches.
#[derive(Module, Debug)]
struct PatchEmbed {
    proj: Linear,
}

impl Dino {
    pub(super) fn new(architecture: DinoArchitecture, device: &Device) -> Self {
        let dim = architecture.dim;
        let zeros = |rows: usize| Initializer::Zeros.init::<3, _>([1, rows, dim], device);
        let attention = AttentionConfig::new(dim, architecture.heads);
        let block = BlockConfig::new(attention, dim * DinoArchitecture::MLP_RATIO)
            .with_norm_epsilon(DinoArchitecture::NORM_EPS)
            .with_layer_scale(Some(1.0));
        let patch = DinoArchitecture::PATCH_SIZE;
        Self {
            cls_token: zeros(1),
            pos_embed: zeros(architecture.position_side.pow(2) + 1),
            register_tokens: (architecture.registers > 0).then(|| zeros(architecture.registers)),
            patch_embed: PatchEmbed { proj: LinearConfig::new(3 * patch * patch, dim).init(device) },
            blocks: (0..architecture.layers).map(|_| block.init(device)).collect(),
            norm: NormConfig::new(dim).with_epsilon(DinoArchitecture::NORM_EPS).init(device),
            architecture,
        }
    }

    /// Channels of a token.
    pub(super) const fn dim(&self) -> usize {
        self.architecture.dim
    }

    /// Normalised patch tokens of the last layer, `[views, patches, channels]`; views are resized to one patch of 14 pixels
    /// per grid cell.
    pub(super) fn forward(&self, views: &Views, grid: Grid, device: &Device) -> Tensor<3> {
        let patch = DinoArchitecture::PATCH_SIZE;
        let resized = views.resized(ImageSize::new(patch * grid.rows, patch * grid.columns));
        let x = self.patch_embed.proj.forward(resized.standardised(patch, MEAN, DEVIATION, device));
        let repeated = |token: Tensor<3>| token.repeat_dim(0, views.len());
        let mut x = Tensor::cat(vec![repeated(self.cls_token.val()), x], 1) + self.positions(grid, device);
        if let Some(registers) = &self.register_tokens {
            let [_, tokens, _] = x.dims();
            let class = x.clone().slice_dim(1, 0..1);
            x = Tensor::cat(vec![class, repeated(registers.val()), x.slice_dim(1, 1..tokens)], 1);
        }
        for block in &self.blocks {
            x = block.forward(x);
        }
        let [_, tokens, _] = x.dims();
        self.norm.forward(x.slice_dim(1, 1 + self.architecture.registers..tokens)).detach()
    }

    /// Position embeddings of the class token and the patches of a grid, `[1, 1 + patches, channels]`.
    fn positions(&self, grid: Grid, device: &Device) -> Tensor<3> {
        let side = self.architecture.position_side;
        let stored = self.pos_embed.val();
        if grid.rows == side && grid.columns == side {
            return stored;
        }
        let dim = self.architecture.dim;
        let class = stored.clone().slice_dim(1, 0..1);
        let patches = f32_values(stored.slice_dim(1, 1..side * side + 1));
        let resized = resized_grid(&patches, side, grid, self.architecture.interpolation);
        let patches = Tensor::<3>::from_data(TensorData::new(resized, [1, grid.len(), dim]), device);
        Tensor::cat(vec![class, patches], 1)
    }
}
