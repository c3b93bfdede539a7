//! The traits of operations on backends.

#[cfg(feature = "gpu-network")]
use burn::backend::Cube;
use burn::backend::tensor::{FloatTensor, IntTensor};
use burn::backend::{Backend, ExtensionType, Flex, backend_extension};

use crate::generic;
use crate::kernels::gather::Sizes as GatherSizes;
use crate::kernels::norm::Segments;

/// Sizes of an attention.
pub(crate) use crate::kernels::attention::Sizes as AttentionSizes;

/// Packed queries, keys and values: the heads of a token are adjacent, `width = heads · head_width` elements.
#[derive(Clone, Debug, ExtensionType)]
pub(crate) enum AttentionInputs<B: Backend> {
    /// `[batch, tokens, 3·width]`: queries, keys and values of a token.
    Together(FloatTensor<B>),
    /// `[batch, queries, width]`, and `[batch, keys, 2·width]`: keys and values of a token.
    Apart { queries: FloatTensor<B>, keys_values: FloatTensor<B> },
}

/// An optional parameter.
#[derive(Clone, Debug, ExtensionType)]
pub(crate) enum Parameter<B: Backend> {
    Given(FloatTensor<B>),
    Absent,
}

impl<B: Backend> Parameter<B> {
    pub(crate) fn into_option(self) -> Option<FloatTensor<B>> {
        match self {
            Self::Given(tensor) => Some(tensor),
            Self::Absent => None,
        }
    }
}

/// The operations, differentiable on `Autodiff`.
#[backend_extension(Cube: cfg(feature = "gpu-network"), Flex, Autodiff)]
pub(crate) trait FusedOps: Backend {
    fn fused_linear(
        x: FloatTensor<Self>,
        weight: FloatTensor<Self>,
        #[extension_type] bias: Parameter<Self>,
    ) -> FloatTensor<Self>;

    fn fused_gelu(x: FloatTensor<Self>) -> FloatTensor<Self>;

    fn fused_norm(
        x: FloatTensor<Self>,
        gamma: FloatTensor<Self>,
        #[extension_type] beta: Parameter<Self>,
        segments: Segments,
    ) -> FloatTensor<Self>;

    fn fused_attention(#[extension_type] inputs: AttentionInputs<Self>, sizes: AttentionSizes) -> FloatTensor<Self>;

    fn gather_rows(x: FloatTensor<Self>, indices: IntTensor<Self>, sizes: GatherSizes) -> FloatTensor<Self>;

    fn gather_max(x: FloatTensor<Self>, indices: IntTensor<Self>, sizes: GatherSizes) -> FloatTensor<Self>;
}

/// Operations without gradients: the forward passes of [`Kernels`].
macro_rules! fused_by_kernels {
    ($backend:ty) => {
        impl FusedOps for $backend {
            fn fused_linear(
                x: FloatTensor<Self>,
                weight: FloatTensor<Self>,
                bias: Parameter<Self>,
            ) -> FloatTensor<Self> {
                Self::affine(x, weight, bias.into_option())
            }

            fn fused_gelu(x: FloatTensor<Self>) -> FloatTensor<Self> {
                Self::gelu_erf(x)
            }

            fn fused_norm(
                x: FloatTensor<Self>,
                gamma: FloatTensor<Self>,
                beta: Parameter<Self>,
                segments: Segments,
            ) -> FloatTensor<Self> {
                Self::norm(x, gamma, beta.into_option(), segments)
            }

            fn fused_attention(inputs: AttentionInputs<Self>, sizes: AttentionSizes) -> FloatTensor<Self> {
                Self::attend(inputs, sizes).0
            }

            fn gather_rows(x: FloatTensor<Self>, indices: IntTensor<Self>, sizes: GatherSizes) -> FloatTensor<Self> {
                Self::rows(x, indices, sizes)
            }

            fn gather_max(x: FloatTensor<Self>, indices: IntTensor<Self>, sizes: GatherSizes) -> FloatTensor<Self> {
                Self::max_rows(x, indices, sizes).0
            }
        }
    };
}

fused_by_kernels!(Flex);

#[cfg(feature = "gpu-network")]
fused_by_kernels!(Cube);

#[cfg(feature = "gpu-network")]
impl Kernels for Cube {}

/// Forward and backward pass of each operation. The default implementations are generic.
pub(crate) trait Kernels: Backend {
    fn affine(x: FloatTensor<Self>, weight: FloatTensor<Self>, bias: Option<FloatTensor<Self>>) -> FloatTensor<Self> {
        generic::rows::linear::<Self>(x, weight, bias)
    }

    fn affine_input_gradient(grad: FloatTensor<Self>, weight: FloatTensor<Self>) -> FloatTensor<Self> {
        generic::rows::linear_input_gradient::<Self>(grad, weight)
    }

    fn affine_weight_gradient(x: FloatTensor<Self>, grad: FloatTensor<Self>) -> FloatTensor<Self> {
        generic::rows::linear_weight_gradient::<Self>(x, grad)
    }

    fn affine_bias_gradient(grad: FloatTensor<Self>) -> FloatTensor<Self> {
        generic::rows::linear_bias_gradient::<Self>(grad)
    }

    fn gelu_erf(x: FloatTensor<Self>) -> FloatTensor<Self> {
        generic::rows::gelu::<Self>(x)
    }

    fn gelu_erf_backward(x: FloatTensor<Self>, grad: FloatTensor<Self>) -> FloatTensor<Self> {
        generic::rows::gelu_backward::<Self>(x, grad)
    }

    fn norm(
        x: FloatTensor<Self>,
        gamma: FloatTensor<Self>,
        beta: Option<FloatTensor<Self>>,
        segments: Segments,
    ) -> FloatTensor<Self> {
        generic::rows::norm::<Self>(x, gamma, beta, segments)
    }

    /// The gradients of `x`, of `gamma`, and of `beta` if there is one.
    fn norm_backward(
        x: FloatTensor<Self>,
        gamma: FloatTensor<Self>,
        has_beta: bool,
        grad: FloatTensor<Self>,
        segments: Segments,
    ) -> (FloatTensor<Self>, FloatTensor<Self>, Option<FloatTensor<Self>>) {
        generic::rows::norm_backward::<Self>(x, gamma, has_beta, grad, segments)
    }

    /// The result, and the log-sum-exp of each row, `[batch, queries, heads]`.
    fn attend(inputs: AttentionInputs<Self>, sizes: AttentionSizes) -> (FloatTensor<Self>, FloatTensor<Self>) {
        generic::attention::forward::<Self>(inputs, sizes)
    }

    fn attend_backward(
        inputs: AttentionInputs<Self>,
        out: FloatTensor<Self>,
        log_sums: FloatTensor<Self>,
        grad: FloatTensor<Self>,
        sizes: AttentionSizes,
    ) -> AttentionInputs<Self> {
        generic::attention::backward::<Self>(inputs, out, log_sums, grad, sizes)
    }

    fn rows(x: FloatTensor<Self>, indices: IntTensor<Self>, sizes: GatherSizes) -> FloatTensor<Self> {
        generic::gather::rows::<Self>(x, indices, sizes)
    }

    fn rows_backward(grad: FloatTensor<Self>, indices: IntTensor<Self>, sizes: GatherSizes) -> FloatTensor<Self> {
        generic::gather::rows_backward::<Self>(grad, indices, sizes)
    }

    /// The maxima, and their rows.
    fn max_rows(
        x: FloatTensor<Self>,
        indices: IntTensor<Self>,
        sizes: GatherSizes,
    ) -> (FloatTensor<Self>, IntTensor<Self>) {
        generic::gather::max::<Self>(x, indices, sizes)
    }

    fn max_rows_backward(grad: FloatTensor<Self>, winners: IntTensor<Self>, sizes: GatherSizes) -> FloatTensor<Self> {
        generic::gather::max_backward::<Self>(grad, winners, sizes)
    }
}
