use atsplat_nn::layers::{Block, Linear};
use atsplat_nn::ops::gather_rows;
use burn::Tensor;
use burn::module::Module;
use burn::tensor::{Device, Int, TensorData};

use super::layers::LayerBuilder;
use super::patches::BranchInput;
use crate::config::{Grid, ModelConfig, Upsampling};

/// The fine branch, to which the decoder attends.
#[derive(Module, Debug)]
pub(super) struct Fine {
    patch: Linear,
    plucker: Linear,
    layers: Vec<Block>,
}

impl Fine {
    pub(super) fn new(config: &ModelConfig, builder: LayerBuilder<'_>) -> Self {
        let (patch, dim) = (config.fine.patch_size.pow(2), builder.transformer.dim);
        Self {
            patch: builder.linear(patch * 3, dim),
            plucker: builder.linear(patch * 6, dim),
            layers: builder.blocks(config.fine.layers),
        }
    }

    /// Features of each view separately: `[scenes · views, patches, channels]`.
    pub(super) fn forward(&self, scenes: &[BranchInput<'_>], patch_size: usize, device: &Device) -> Tensor<3> {
        let tokens = scenes.iter().map(|scene| {
            let plucker = self.plucker.forward(scene.plucker(patch_size, device));
            self.patch.forward(scene.colours(patch_size, device)) + plucker
        });
        self.layers.iter().fold(Tensor::cat(tokens.collect(), 0), |x, layer| layer.forward(x))
    }
}

/// Upsamples features of coarse patches, `[views, coarse, channels]`, to a grid finer by a whole factor.
pub(super) fn upsampled(x: &Tensor<3>, from: Grid, to: Grid, rule: Upsampling, device: &Device) -> Tensor<3> {
    let [views, _, _] = x.dims();
    let (rows, columns) = (taps(from.rows, to.rows, rule), taps(from.columns, to.columns, rule));
    let corners = match rule {
        Upsampling::Nearest => 1,
        Upsampling::Bilinear => 2,
    };
    let mut sum: Option<Tensor<3>> = None;
    for row in 0..corners {
        for column in 0..corners {
            let cells = rows.iter().flat_map(|y| columns.iter().map(move |x| (y[row], x[column])));
            let (indices, weights): (Vec<i64>, Vec<f32>) = cells
                .map(|((y, weight_y), (x, weight_x))| {
                    ((y * from.columns + x).cast_signed() as i64, weight_y * weight_x)
                })
                .unzip();
            let indices = Tensor::<2, Int>::from_data(TensorData::new(indices, [1, to.len()]), device);
            let picked = gather_rows(x.clone(), indices.repeat_dim(0, views));
            let weights = Tensor::<3>::from_data(TensorData::new(weights, [1, to.len(), 1]), device);
            let weighted = picked * weights;
            sum = Some(match sum {
                Some(sum) => sum + weighted,
                None => weighted,
            });
        }
    }
    #[expect(clippy::expect_used, reason = "either rule has corners")]
    sum.expect("at least one corner")
}

/// For each fine sample, the two coarse samples around its centre with their weights.
fn taps(from: usize, to: usize, rule: Upsampling) -> Vec<[(usize, f32); 2]> {
    let ratio = to as f64 / from as f64;
    let last = from.saturating_sub(1);
    let sample = |at: usize| {
        let centre = (at as f64 + 0.5) / ratio;
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "not negative, and below `from`")]
        match rule {
            Upsampling::Nearest => [((centre as usize).min(last), 1.0), (0, 0.0)],
            Upsampling::Bilinear => {
                let source = if centre > 0.5 { centre - 0.5 } else { 0.0 };
                let before = source as usize;
                let share = (source - before as f64) as f32;
                [(before.min(last), 1.0 - share), ((before + 1).min(last), share)]
            }
        }
    };
    (0..to).map(sample).collect()
}
