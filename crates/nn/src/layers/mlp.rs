use burn::Tensor;
use burn::config::Config;
use burn::module::{Initializer, Module};
use burn::tensor::Device;

use super::{Linear, LinearConfig};
use crate::ops;

/// Configuration of an [`Mlp`].
#[derive(Config, Debug)]
pub struct MlpConfig {
    /// Elements of an input row.
    pub inputs: usize,
    /// Hidden elements.
    pub hidden: usize,
    /// Elements of an output row.
    pub outputs: usize,
    /// Whether both layers add a bias.
    #[config(default = true)]
    pub bias: bool,
    /// Initialiser of the weights.
    #[config(default = "Initializer::Normal { mean: 0.0, std: 0.02 }")]
    pub initializer: Initializer,
}

impl MlpConfig {
    /// An MLP with newly initialised parameters.
    pub fn init(&self, device: &Device) -> Mlp {
        let layer = |inputs, outputs| {
            let config = LinearConfig::new(inputs, outputs).with_bias(self.bias);
            config.with_initializer(self.initializer.clone()).init(device)
        };
        Mlp { fc1: layer(self.inputs, self.hidden), fc2: layer(self.hidden, self.outputs) }
    }
}

/// Linear, erf-GELU, linear.
#[derive(Module, Debug)]
pub struct Mlp {
    /// The first layer.
    pub fc1: Linear,
    /// The second layer.
    pub fc2: Linear,
}

impl Mlp {
    /// `[…, inputs]` to `[…, outputs]`.
    ///
    /// # Panics
    /// If the last dimension is not of `inputs` elements.
    pub fn forward<const D: usize>(&self, x: Tensor<D>) -> Tensor<D> {
        self.fc2.forward(ops::gelu(self.fc1.forward(x)))
    }
}
