use burn::backend::Backend;
use burn::backend::tensor::FloatTensor;

use super::Array;
use crate::NormKind;
use crate::kernels::norm::Segments;

/// `x · weight + bias` along the last dimension.
pub(crate) fn linear<B: Backend>(
    x: FloatTensor<B>,
    weight: FloatTensor<B>,
    bias: Option<FloatTensor<B>>,
) -> FloatTensor<B> {
    let (x, weight) = (Array::<B>(x), Array::<B>(weight));
    let mut shape = x.dims();
    let outputs = weight.dims()[1];
    let rows = flat(x).matmul(weight);
    let rows = match bias {
        Some(bias) => rows + Array::<B>(bias).reshape(&[1, outputs]),
        None => rows,
    };
    if let Some(last) = shape.last_mut() {
        *last = outputs;
    }
    rows.reshape(&shape).0
}

/// The gradient of the input of [`linear`].
pub(crate) fn linear_input_gradient<B: Backend>(grad: FloatTensor<B>, weight: FloatTensor<B>) -> FloatTensor<B> {
    let (grad, weight) = (Array::<B>(grad), Array::<B>(weight));
    let mut shape = grad.dims();
    if let Some(last) = shape.last_mut() {
        *last = weight.dims()[0];
    }
    flat(grad).matmul(weight.transposed()).reshape(&shape).0
}

/// The gradient of the weight of [`linear`].
pub(crate) fn linear_weight_gradient<B: Backend>(x: FloatTensor<B>, grad: FloatTensor<B>) -> FloatTensor<B> {
    flat(Array::<B>(x)).transposed().matmul(flat(Array(grad))).0
}

/// The gradient of the bias of [`linear`].
pub(crate) fn linear_bias_gradient<B: Backend>(grad: FloatTensor<B>) -> FloatTensor<B> {
    let grad = flat(Array::<B>(grad));
    let outputs = grad.dims()[1];
    grad.sum(0).reshape(&[outputs]).0
}

/// `Φ(−x)` and the density underflow here in every element type.
const TAIL: f64 = 50.0;

/// `x·Φ(x)`.
pub(crate) fn gelu<B: Backend>(x: FloatTensor<B>) -> FloatTensor<B> {
    let x = Array::<B>(x);
    // Infinity times 0 would be NaN.
    (x.clone().at_least(-TAIL) * probability(x)).0
}

/// The gradient of the input of [`gelu`].
pub(crate) fn gelu_backward<B: Backend>(x: FloatTensor<B>, grad: FloatTensor<B>) -> FloatTensor<B> {
    let x = Array::<B>(x);
    let density = (x.clone() * x.clone()).times(-0.5).exp().times((0.5 / std::f64::consts::PI).sqrt());
    (Array(grad) * (probability(x.clone()) + x.at_least(-TAIL).at_most(TAIL) * density)).0
}

fn probability<B: Backend>(x: Array<B>) -> Array<B> {
    x.times(std::f64::consts::FRAC_1_SQRT_2).erf().plus(1.0).times(0.5)
}

/// Normalises segments of rows.
pub(crate) fn norm<B: Backend>(
    x: FloatTensor<B>,
    gamma: FloatTensor<B>,
    beta: Option<FloatTensor<B>>,
    segments: Segments,
) -> FloatTensor<B> {
    let x = Array::<B>(x);
    let (shape, x) = (x.dims(), flat(x));
    let normalised = standard(segmented(x.clone(), &segments), &segments).0 * per_part(Array(gamma), &segments);
    let normalised = match beta {
        Some(beta) => normalised + per_part(Array(beta), &segments),
        None => normalised,
    };
    replace_segments(x, normalised, &segments).reshape(&shape).0
}

/// The gradients of `x`, of `gamma`, and of `beta` if there is one, of [`norm`].
pub(crate) fn norm_backward<B: Backend>(
    x: FloatTensor<B>,
    gamma: FloatTensor<B>,
    has_beta: bool,
    grad: FloatTensor<B>,
    segments: Segments,
) -> (FloatTensor<B>, FloatTensor<B>, Option<FloatTensor<B>>) {
    let x = Array::<B>(x);
    let (shape, x, all_grad) = (x.dims(), flat(x), flat(Array::<B>(grad)));
    let (standard, scale) = standard(segmented(x, &segments), &segments);
    let grad = segmented(all_grad.clone(), &segments);
    let over_rows = |sums: Array<B>| sums.sum(0).sum(2).reshape(&[segments.parts, segments.length]).0;
    let by_gamma = over_rows(grad.clone() * standard.clone());
    let by_beta = has_beta.then(|| over_rows(grad.clone()));

    let scaled = grad * per_part(Array(gamma), &segments);
    let along = (scaled.clone() * standard.clone()).mean(3);
    let across = match segments.kind {
        NormKind::Layer => scaled.clone() - scaled.mean(3),
        NormKind::Rms => scaled,
    };
    let by_x = (across - standard * along) * scale;
    (replace_segments(all_grad, by_x, &segments).reshape(&shape).0, by_gamma, by_beta)
}

/// `[rows, parts, heads, length]` of the segments that are normalised.
fn segmented<B: Backend>(rows: Array<B>, segments: &Segments) -> Array<B> {
    let Segments { parts, heads, length, .. } = *segments;
    let count = rows.dims()[0];
    rows.range(1, 0..parts * heads * length).reshape(&[count, parts, heads, length])
}

fn replace_segments<B: Backend>(rows: Array<B>, value: Array<B>, segments: &Segments) -> Array<B> {
    let count = rows.dims()[0];
    let normalised = segments.parts * segments.heads * segments.length;
    let value = value.reshape(&[count, normalised]);
    if normalised == segments.width { value } else { rows.with_range(1, 0..normalised, value) }
}

fn per_part<B: Backend>(parameters: Array<B>, segments: &Segments) -> Array<B> {
    parameters.reshape(&[1, segments.parts, 1, segments.length])
}

/// Normalised segments, and the reciprocal of their standard deviation or RMS.
fn standard<B: Backend>(x: Array<B>, segments: &Segments) -> (Array<B>, Array<B>) {
    let off = match segments.kind {
        NormKind::Layer => x.clone() - x.mean(3),
        NormKind::Rms => x,
    };
    let spread = (off.clone() * off.clone()).mean(3).plus(segments.epsilon).sqrt();
    let one = spread.clone().times(0.0).plus(1.0);
    let scale = one / spread;
    (off * scale.clone(), scale)
}

/// Flattens all dimensions except the last.
fn flat<B: Backend>(x: Array<B>) -> Array<B> {
    let dims = x.dims();
    let (last, others) = dims.split_last().map_or((1, 1), |(&last, others)| (last, others.iter().product()));
    x.reshape(&[others, last])
}
