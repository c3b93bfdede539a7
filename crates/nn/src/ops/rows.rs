use burn::Tensor;
use burn::backend::Dispatch;

use crate::NormKind;
use crate::backend::{FusedOps, Parameter};
use crate::kernels::norm::Segments;

/// `x · weight + bias` along the last dimension: `[…, inputs]` to `[…, outputs]`.
///
/// `weight` is `[inputs, outputs]` and `bias` `[outputs]`, as in burn; PyTorch stores the weight transposed.
///
/// # Panics
/// If the shapes do not fit together.
pub fn linear<const D: usize>(x: Tensor<D>, weight: Tensor<2>, bias: Option<Tensor<1>>) -> Tensor<D> {
    let [inputs, outputs] = weight.dims();
    assert_eq!(last(&x), inputs, "last dimension of the input of a linear layer of {inputs} inputs");
    if let Some(bias) = &bias {
        assert_eq!(bias.dims(), [outputs], "shape of the bias of a linear layer of {outputs} outputs");
    }
    Tensor::from_dispatch(Dispatch::fused_linear(x.into_dispatch(), weight.into_dispatch(), parameter(bias)))
}

/// The Gaussian error linear unit in its exact form, `x · Φ(x)` with `Φ(x) = ½(1 + erf(x / √2))`; any shape.
///
/// −∞ gives 0, its limit (PyTorch gives NaN); NaN gives NaN. In f32 on the CPU, the relative error stays small in the far
/// negative tail; other element types and devices have only a small absolute error there.
pub fn gelu<const D: usize>(x: Tensor<D>) -> Tensor<D> {
    Tensor::from_dispatch(Dispatch::fused_gelu(x.into_dispatch()))
}

/// `(x − mean) / √(variance + epsilon) · gamma + beta` along the last dimension, with the biased variance; any shape.
///
/// `gamma` and `beta` have the last dimension's size. A row with a non-finite element becomes NaN; other rows do not.
///
/// # Panics
/// If the shapes do not fit together.
pub fn layer_norm<const D: usize>(x: Tensor<D>, gamma: Tensor<1>, beta: Option<Tensor<1>>, epsilon: f64) -> Tensor<D> {
    check_whole_rows(&x, &gamma);
    normalize_heads(x, 1, gamma.unsqueeze(), beta.map(Tensor::unsqueeze), NormKind::Layer, epsilon)
}

/// `x / √(mean of x² + epsilon) · gamma` along the last dimension, whose size `gamma` has; any shape.
///
/// # Panics
/// If the shapes do not fit together.
pub fn rms_norm<const D: usize>(x: Tensor<D>, gamma: Tensor<1>, epsilon: f64) -> Tensor<D> {
    check_whole_rows(&x, &gamma);
    normalize_heads(x, 1, gamma.unsqueeze(), None, NormKind::Rms, epsilon)
}

fn check_whole_rows<const D: usize>(x: &Tensor<D>, gamma: &Tensor<1>) {
    assert_eq!(gamma.dims(), [last(x)], "shape of gamma and elements of a row");
}

/// Normalises the heads at the beginning of each token, for QK-norm on packed tensors.
///
/// `gamma` and `beta` are `[parts, head_width]`. The first `parts · heads · head_width` elements of a token are normalised
/// head by head; those of part p are multiplied by row p of `gamma`, and row p of `beta` is added. Other elements are not
/// changed: two parts normalise queries and keys of packed `[q, k, v]`, one part the keys of packed `[k, v]`.
///
/// # Panics
/// If the shapes do not fit together.
pub fn normalize_heads<const D: usize>(
    x: Tensor<D>,
    heads: usize,
    gamma: Tensor<2>,
    beta: Option<Tensor<2>>,
    kind: NormKind,
    epsilon: f64,
) -> Tensor<D> {
    let ([parts, length], width) = (gamma.dims(), last(&x));
    assert!(
        parts * heads * length <= width,
        "expected tokens with {parts} parts of {heads} heads of {length} elements, found {width} elements"
    );
    if let Some(beta) = &beta {
        assert_eq!(beta.dims(), gamma.dims(), "shape of beta and gamma");
    }
    let segments = Segments { kind, epsilon, width, parts, heads, length };
    Tensor::from_dispatch(Dispatch::fused_norm(x.into_dispatch(), gamma.into_dispatch(), parameter(beta), segments))
}

fn parameter<const D: usize>(tensor: Option<Tensor<D>>) -> Parameter<Dispatch> {
    tensor.map_or(Parameter::Absent, |tensor| Parameter::Given(tensor.into_dispatch()))
}

fn last<const D: usize>(x: &Tensor<D>) -> usize {
    x.dims().last().copied().unwrap_or(1)
}
