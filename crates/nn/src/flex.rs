//! The kernels on burn's CPU backend, for f32; other element types use the generic implementation.

use burn::backend::ops::IntTensorOps;
use burn::backend::tensor::{FloatTensor, IntTensor};
use burn::backend::{DType, Flex, IntDType, TensorMetadata};
use burn::tensor::{Bytes, Shape};
use burn_flex::{FlexTensor, Layout};

use crate::backend::{AttentionInputs, AttentionSizes, Kernels};
use crate::kernels::attention::{Inputs, Tokens};
use crate::kernels::attention_backward::{self, HeadGradients};
use crate::kernels::gather::Sizes as GatherSizes;
use crate::kernels::norm::Segments;
use crate::kernels::{attention, gather, gelu, linear, norm};
use crate::{MatmulPrecision, generic};

impl Kernels for Flex {
    fn affine(x: FloatTensor<Self>, weight: FloatTensor<Self>, bias: Option<FloatTensor<Self>>) -> FloatTensor<Self> {
        let (contiguous_x, contiguous_weight) = (dense(&x), dense(&weight));
        let contiguous_bias = bias.as_ref().map(dense);
        let (Some(slice), Some(weights), biases @ (None | Some(Some(_)))) =
            (floats(&contiguous_x), floats(&contiguous_weight), contiguous_bias.as_ref().map(floats))
        else {
            return generic::rows::linear::<Self>(x, weight, bias);
        };
        let [inputs, outputs] = contiguous_weight.shape().dims();
        let out = linear::forward(slice, weights, biases.flatten(), inputs, outputs);
        tensor(out, with_last(&x, outputs))
    }

    fn affine_input_gradient(grad: FloatTensor<Self>, weight: FloatTensor<Self>) -> FloatTensor<Self> {
        let (contiguous_grad, contiguous_weight) = (dense(&grad), dense(&weight));
        let (Some(slice), Some(weights)) = (floats(&contiguous_grad), floats(&contiguous_weight)) else {
            return generic::rows::linear_input_gradient::<Self>(grad, weight);
        };
        let [inputs, outputs] = contiguous_weight.shape().dims();
        tensor(linear::input_gradient(slice, weights, inputs, outputs), with_last(&grad, inputs))
    }

    fn affine_weight_gradient(x: FloatTensor<Self>, grad: FloatTensor<Self>) -> FloatTensor<Self> {
        let (contiguous_x, contiguous_grad) = (dense(&x), dense(&grad));
        let (Some(slice), Some(grads)) = (floats(&contiguous_x), floats(&contiguous_grad)) else {
            return generic::rows::linear_weight_gradient::<Self>(x, grad);
        };
        let (inputs, outputs) = (last(&x), last(&grad));
        tensor(linear::weight_gradient(slice, grads, inputs, outputs), Shape::new([inputs, outputs]))
    }

    fn affine_bias_gradient(grad: FloatTensor<Self>) -> FloatTensor<Self> {
        let contiguous = dense(&grad);
        let Some(slice) = floats(&contiguous) else {
            return generic::rows::linear_bias_gradient::<Self>(grad);
        };
        let outputs = last(&grad);
        tensor(linear::bias_gradient(slice, outputs), Shape::new([outputs]))
    }

    fn gelu_erf(x: FloatTensor<Self>) -> FloatTensor<Self> {
        let contiguous = dense(&x);
        match floats(&contiguous) {
            Some(slice) => tensor(gelu::forward(slice), x.shape()),
            None => generic::rows::gelu::<Self>(x),
        }
    }

    fn gelu_erf_backward(x: FloatTensor<Self>, grad: FloatTensor<Self>) -> FloatTensor<Self> {
        let (contiguous_x, contiguous_grad) = (dense(&x), dense(&grad));
        match (floats(&contiguous_x), floats(&contiguous_grad)) {
            (Some(slice), Some(grads)) => tensor(gelu::backward(slice, grads), x.shape()),
            _ => generic::rows::gelu_backward::<Self>(x, grad),
        }
    }

    fn norm(
        x: FloatTensor<Self>,
        gamma: FloatTensor<Self>,
        beta: Option<FloatTensor<Self>>,
        segments: Segments,
    ) -> FloatTensor<Self> {
        let (contiguous_x, contiguous_gamma) = (dense(&x), dense(&gamma));
        let contiguous_beta = beta.as_ref().map(dense);
        let (Some(slice), Some(gammas), betas @ (None | Some(Some(_)))) =
            (floats(&contiguous_x), floats(&contiguous_gamma), contiguous_beta.as_ref().map(floats))
        else {
            return generic::rows::norm::<Self>(x, gamma, beta, segments);
        };
        tensor(norm::forward(slice, gammas, betas.flatten(), segments), x.shape())
    }

    fn norm_backward(
        x: FloatTensor<Self>,
        gamma: FloatTensor<Self>,
        has_beta: bool,
        grad: FloatTensor<Self>,
        segments: Segments,
    ) -> (FloatTensor<Self>, FloatTensor<Self>, Option<FloatTensor<Self>>) {
        let [contiguous_x, contiguous_gamma, contiguous_grad] = [&x, &gamma, &grad].map(dense);
        let (Some(slice), Some(gammas), Some(grads)) =
            (floats(&contiguous_x), floats(&contiguous_gamma), floats(&contiguous_grad))
        else {
            return generic::rows::norm_backward::<Self>(x, gamma, has_beta, grad, segments);
        };
        let (by_x, by_gamma, by_beta) = norm::backward(slice, gammas, has_beta, grads, segments);
        let of_parameters = |gradient| tensor(gradient, Shape::new([segments.parts, segments.length]));
        (tensor(by_x, x.shape()), of_parameters(by_gamma), by_beta.map(of_parameters))
    }

    fn attend(inputs: AttentionInputs<Self>, sizes: AttentionSizes) -> (FloatTensor<Self>, FloatTensor<Self>) {
        let packed = Packed::new(&inputs);
        let Some(kernel_inputs) = packed.view(sizes) else {
            return generic::attention::forward::<Self>(inputs, sizes);
        };
        let (out, log_sums) = attention::forward(&kernel_inputs);
        let shape = |width| Shape::new([sizes.batch, sizes.queries, width]);
        (tensor(out, shape(sizes.width())), tensor(log_sums, shape(sizes.heads)))
    }

    fn attend_backward(
        inputs: AttentionInputs<Self>,
        out: FloatTensor<Self>,
        log_sums: FloatTensor<Self>,
        grad: FloatTensor<Self>,
        sizes: AttentionSizes,
    ) -> AttentionInputs<Self> {
        let packed = Packed::new(&inputs);
        let contiguous = [&out, &log_sums, &grad].map(dense);
        let [outs, sums, grads] = contiguous.each_ref().map(floats);
        let (Some(view), Some(outs), Some(sums), Some(grads)) = (packed.view(sizes), outs, sums, grads) else {
            return generic::attention::backward::<Self>(inputs, out, log_sums, grad, sizes);
        };
        let gradients = attention_backward::backward(&view, outs, sums, grads);
        let kinds: [fn(&HeadGradients) -> &[f32]; 3] = [|of| &of.queries, |of| &of.keys, |of| &of.values];
        let pack = |kinds: &[_], tokens| {
            let shape = Shape::new([sizes.batch, tokens, kinds.len() * sizes.width()]);
            tensor(attention_backward::pack(&gradients, kinds, tokens, &sizes), shape)
        };
        match inputs {
            AttentionInputs::Together(_) => AttentionInputs::Together(pack(&kinds, sizes.queries)),
            AttentionInputs::Apart { .. } => AttentionInputs::Apart {
                queries: pack(&kinds[..1], sizes.queries),
                keys_values: pack(&kinds[1..], sizes.keys),
            },
        }
    }

    fn rows(x: FloatTensor<Self>, indices: IntTensor<Self>, sizes: GatherSizes) -> FloatTensor<Self> {
        let contiguous = dense(&x);
        match floats(&contiguous) {
            Some(slice) => {
                let out = gather::rows(slice, &row_indices(indices, sizes.rows), sizes);
                tensor(out, Shape::new([sizes.batch, sizes.picks, sizes.width]))
            }
            None => generic::gather::rows::<Self>(x, indices, sizes),
        }
    }

    fn rows_backward(grad: FloatTensor<Self>, indices: IntTensor<Self>, sizes: GatherSizes) -> FloatTensor<Self> {
        let contiguous = dense(&grad);
        match floats(&contiguous) {
            Some(slice) => {
                let out = gather::rows_backward(slice, &row_indices(indices, sizes.rows), sizes);
                tensor(out, Shape::new([sizes.batch, sizes.rows, sizes.width]))
            }
            None => generic::gather::rows_backward::<Self>(grad, indices, sizes),
        }
    }

    fn max_rows(
        x: FloatTensor<Self>,
        indices: IntTensor<Self>,
        sizes: GatherSizes,
    ) -> (FloatTensor<Self>, IntTensor<Self>) {
        let contiguous = dense(&x);
        match floats(&contiguous) {
            Some(slice) => {
                let (out, winners) = gather::max(slice, &row_indices(indices, sizes.rows), sizes);
                let shape = Shape::new([sizes.batch, sizes.picks, sizes.width]);
                let winners =
                    FlexTensor::new(Bytes::from_elems(winners), Layout::contiguous(shape.clone()), DType::I64);
                (tensor(out, shape), winners)
            }
            None => generic::gather::max::<Self>(x, indices, sizes),
        }
    }

    fn max_rows_backward(grad: FloatTensor<Self>, winners: IntTensor<Self>, sizes: GatherSizes) -> FloatTensor<Self> {
        let (contiguous_grad, contiguous_winners) = (dense(&grad), dense(&winners));
        match (floats(&contiguous_grad), contiguous_winners.as_slice::<i64>()) {
            (Some(slice), Some(rows)) => {
                let out = gather::max_backward(slice, rows, sizes);
                tensor(out, Shape::new([sizes.batch, sizes.rows, sizes.width]))
            }
            _ => generic::gather::max_backward::<Self>(grad, winners, sizes),
        }
    }
}

/// Contiguous inputs of an attention.
struct Packed {
    queries: FlexTensor,
    keys_values: Option<FlexTensor>,
}

impl Packed {
    fn new(inputs: &AttentionInputs<Flex>) -> Self {
        match inputs {
            AttentionInputs::Together(packed) => Self { queries: dense(packed), keys_values: None },
            AttentionInputs::Apart { queries, keys_values } => {
                Self { queries: dense(queries), keys_values: Some(dense(keys_values)) }
            }
        }
    }

    /// The slices, if they are f32.
    fn view(&self, sizes: AttentionSizes) -> Option<Inputs<'_>> {
        let width = sizes.width();
        let queries = floats(&self.queries)?;
        let (query_parts, keys_values, key_parts) = match &self.keys_values {
            None => (3, queries, 3),
            Some(packed) => (1, floats(packed)?, 2),
        };
        let of_keys = |from_last| Tokens {
            data: keys_values,
            count: sizes.keys,
            stride: key_parts * width,
            offset: (key_parts - from_last) * width,
        };
        Some(Inputs {
            queries: Tokens { data: queries, count: sizes.queries, stride: query_parts * width, offset: 0 },
            keys: of_keys(2),
            values: of_keys(1),
            sizes,
            precision: MatmulPrecision::current(),
        })
    }
}

/// The tensor without gaps between its elements: a copy only if there are any, and not if it is merely a part of a larger one.
fn dense(tensor: &FlexTensor) -> FlexTensor {
    if tensor.is_contiguous() { tensor.clone() } else { tensor.to_contiguous() }
}

/// The elements, if they are f32 without gaps.
fn floats(tensor: &FlexTensor) -> Option<&[f32]> {
    tensor.as_slice::<f32>()
}

fn tensor(data: Vec<f32>, shape: Shape) -> FlexTensor {
    FlexTensor::new(Bytes::from_elems(data), Layout::contiguous(shape), DType::F32)
}

fn last(tensor: &FlexTensor) -> usize {
    tensor.shape().last().copied().unwrap_or(1)
}

fn with_last(like: &FlexTensor, size: usize) -> Shape {
    let mut dims = like.shape().to_vec();
    if let Some(last) = dims.last_mut() {
        *last = size;
    }
    Shape::from(dims)
}

/// Row indices, checked.
///
/// # Panics
/// If an index is not below `rows`.
#[expect(clippy::expect_used, reason = "indices were cast to i64, and checked")]
fn row_indices(indices: FlexTensor, rows: usize) -> Vec<usize> {
    let indices = Flex::int_cast(indices, IntDType::I64).to_contiguous();
    let row = |&index: &i64| {
        let row = usize::try_from(index);
        assert!(row.is_ok_and(|row| row < rows), "row index {index}, expected below {rows}");
        row.expect("a row index")
    };
    indices.as_slice::<i64>().expect("indices of 64 bits").iter().map(row).collect()
}
