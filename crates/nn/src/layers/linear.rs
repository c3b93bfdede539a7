use burn::Tensor;
use burn::config::Config;
use burn::module::{Initializer, Module, Param};
use burn::tensor::Device;

use crate::ops;

/// Configuration of a [`Linear`].
#[derive(Config, Debug)]
pub struct LinearConfig {
    /// Elements of an input row.
    pub inputs: usize,
    /// Elements of an output row.
    pub outputs: usize,
    /// Whether a bias is added.
    #[config(default = true)]
    pub bias: bool,
    /// Initialiser of the weight; the bias starts at 0.
    #[config(default = "Initializer::Normal { mean: 0.0, std: 0.02 }")]
    pub initializer: Initializer,
}

impl LinearConfig {
    /// A layer with newly initialised parameters.
    pub fn init(&self, device: &Device) -> Linear {
        let shape = [self.inputs, self.outputs];
        Linear {
            weight: self.initializer.init_with(shape, Some(self.inputs), Some(self.outputs), device),
            bias: self.bias.then(|| Initializer::Zeros.init([self.outputs], device)),
        }
    }
}

/// `x · weight + bias` along the last dimension.
#[derive(Module, Debug)]
pub struct Linear {
    /// `[inputs, outputs]`, transposed relative to PyTorch.
    pub weight: Param<Tensor<2>>,
    /// `[outputs]`.
    pub bias: Option<Param<Tensor<1>>>,
}

impl Linear {
    /// `[…, inputs]` to `[…, outputs]`.
    ///
    /// # Panics
    /// If the last dimension is not of `inputs` elements.
    pub fn forward<const D: usize>(&self, x: Tensor<D>) -> Tensor<D> {
        ops::linear(x, self.weight.val(), self.bias.as_ref().map(Param::val))
    }
}
