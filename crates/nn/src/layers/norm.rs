use burn::Tensor;
use burn::config::Config;
use burn::module::{Initializer, Module, Param};
use burn::tensor::Device;

use crate::{NormKind, ops};

/// Configuration of a [`Norm`].
#[derive(Config, Debug)]
pub struct NormConfig {
    /// Number of elements that are normalised together.
    pub width: usize,
    /// Layer norm or RMS norm.
    #[config(default = "NormKind::Layer")]
    pub kind: NormKind,
    /// Whether layer norm adds a `beta`; RMS norm never does.
    #[config(default = true)]
    pub bias: bool,
    /// Added to the variance or the mean square.
    #[config(default = 1e-5)]
    pub epsilon: f64,
}

impl NormConfig {
    /// A layer with `gamma` 1 and `beta` 0.
    pub fn init(&self, device: &Device) -> Norm {
        let bias = self.bias && self.kind == NormKind::Layer;
        Norm {
            gamma: Initializer::Ones.init([self.width], device),
            beta: bias.then(|| Initializer::Zeros.init([self.width], device)),
            kind: self.kind,
            epsilon: self.epsilon,
        }
    }
}

/// Layer norm or RMS norm along the last dimension.
#[derive(Module, Debug)]
pub struct Norm {
    /// `[width]`; PyTorch's `weight`.
    pub gamma: Param<Tensor<1>>,
    /// `[width]`; PyTorch's `bias`.
    pub beta: Option<Param<Tensor<1>>>,
    /// Layer norm or RMS norm.
    #[module(skip)]
    pub kind: NormKind,
    /// Added to the variance or the mean square.
    #[module(skip)]
    pub epsilon: f64,
}

impl Norm {
    /// `[…, width]` to the same.
    ///
    /// # Panics
    /// If the last dimension is not of `width` elements.
    pub fn forward<const D: usize>(&self, x: Tensor<D>) -> Tensor<D> {
        match self.kind {
            NormKind::Layer => ops::layer_norm(x, self.gamma.val(), self.beta.as_ref().map(Param::val), self.epsilon),
            NormKind::Rms => ops::rms_norm(x, self.gamma.val(), self.epsilon),
        }
    }

    /// Normalises the heads at the beginning of packed tokens; `norms` has one norm per part, all of one kind.
    pub(super) fn heads<const D: usize>(norms: &[&Self], x: Tensor<D>, heads: usize) -> Tensor<D> {
        let Some(first) = norms.first() else { return x };
        let gamma = Tensor::stack(norms.iter().map(|norm| norm.gamma.val()).collect(), 0);
        let betas: Vec<_> = norms.iter().filter_map(|norm| norm.beta.as_ref().map(Param::val)).collect();
        let beta = (!betas.is_empty()).then(|| Tensor::stack(betas, 0));
        ops::normalize_heads(x, heads, gamma, beta, first.kind, first.epsilon)
    }
}
