//! Backward passes of the operations in burn's autodiff graph.

use burn::backend::Autodiff;
use burn::backend::TensorMetadata;
use burn::backend::autodiff::checkpoint::{base::Checkpointer, strategy::CheckpointStrategy};
use burn::backend::autodiff::grads::Gradients;
use burn::backend::autodiff::ops::{Backward, Ops, OpsKind};
use burn::backend::tensor::{FloatTensor, IntTensor};

use crate::MatmulPrecision;
use crate::backend::{AttentionInputs, AttentionSizes, FusedOps, Kernels, Parameter};
use crate::kernels::gather::Sizes as GatherSizes;
use crate::kernels::norm::Segments;

/// Adds an operation to the graph, with its state if a gradient is needed.
macro_rules! finish {
    ($step:expr, $nodes:expr, $state:expr, $out:expr) => {
        match $step.prepare::<C>($nodes).compute_bound().stateful() {
            OpsKind::Tracked(prepared) => prepared.finish($state, $out),
            OpsKind::UnTracked(prepared) => prepared.finish($out),
        }
    };
}

/// An optional parameter and its node; without one, that of the input, a parent that is not used.
macro_rules! with_node {
    ($parameter:expr, $input:expr) => {
        match $parameter {
            Parameter::Given(given) => (Some(given.primitive().clone()), given.node()),
            Parameter::Absent => (None, $input.node()),
        }
    };
}

impl<B: Kernels, C: CheckpointStrategy> FusedOps for Autodiff<B, C> {
    fn fused_linear(x: FloatTensor<Self>, weight: FloatTensor<Self>, bias: Parameter<Self>) -> FloatTensor<Self> {
        let (bias, bias_node) = with_node!(bias, x);
        let nodes = [x.node(), weight.node(), bias_node];
        let (x, weight) = (x.primitive().clone(), weight.primitive().clone());
        let has_bias = bias.is_some();
        let out = B::affine(x.clone(), weight.clone(), bias);
        let state = LinearState { x, weight, has_bias, precision: MatmulPrecision::current() };
        finish!(Linear, nodes, state, out)
    }

    fn fused_gelu(x: FloatTensor<Self>) -> FloatTensor<Self> {
        let nodes = [x.node()];
        let x = x.primitive().clone();
        let out = B::gelu_erf(x.clone());
        finish!(Gelu, nodes, x, out)
    }

    fn fused_norm(
        x: FloatTensor<Self>,
        gamma: FloatTensor<Self>,
        beta: Parameter<Self>,
        segments: Segments,
    ) -> FloatTensor<Self> {
        let (beta, beta_node) = with_node!(beta, x);
        let nodes = [x.node(), gamma.node(), beta_node];
        let (x, gamma) = (x.primitive().clone(), gamma.primitive().clone());
        let has_beta = beta.is_some();
        let out = B::norm(x.clone(), gamma.clone(), beta, segments);
        finish!(Norm, nodes, (x, gamma, has_beta, segments), out)
    }

    fn fused_attention(inputs: AttentionInputs<Self>, sizes: AttentionSizes) -> FloatTensor<Self> {
        let (inputs, nodes) = match inputs {
            AttentionInputs::Together(packed) => {
                (AttentionInputs::Together(packed.primitive().clone()), [packed.node(), packed.node()])
            }
            AttentionInputs::Apart { queries, keys_values } => {
                let nodes = [queries.node(), keys_values.node()];
                let (queries, keys_values) = (queries.primitive().clone(), keys_values.primitive().clone());
                (AttentionInputs::Apart { queries, keys_values }, nodes)
            }
        };
        let (out, log_sums) = B::attend(inputs.clone(), sizes);
        let state = AttentionState { inputs, out: out.clone(), log_sums, sizes, precision: MatmulPrecision::current() };
        finish!(Attention, nodes, state, out)
    }

    fn gather_rows(x: FloatTensor<Self>, indices: IntTensor<Self>, sizes: GatherSizes) -> FloatTensor<Self> {
        let nodes = [x.node()];
        let out = B::rows(x.primitive().clone(), indices.clone(), sizes);
        finish!(Rows, nodes, (indices, sizes), out)
    }

    fn gather_max(x: FloatTensor<Self>, indices: IntTensor<Self>, sizes: GatherSizes) -> FloatTensor<Self> {
        let nodes = [x.node()];
        let (out, winners) = B::max_rows(x.primitive().clone(), indices, sizes);
        finish!(MaxRows, nodes, (winners, sizes), out)
    }
}

#[derive(Debug)]
struct Linear;

#[derive(Clone, Debug)]
struct LinearState<B: Kernels> {
    x: FloatTensor<B>,
    weight: FloatTensor<B>,
    has_bias: bool,
    /// That of the forward pass.
    precision: MatmulPrecision,
}

impl<B: Kernels> Backward<B, 3> for Linear {
    type State = LinearState<B>;

    fn backward(self, ops: Ops<Self::State, 3>, grads: &mut Gradients, _: &mut Checkpointer) {
        let [x_node, weight_node, bias_node] = ops.parents;
        let LinearState { x, weight, has_bias, precision } = ops.state;
        let grad = grads.consume::<B>(&ops.node);
        if let Some(node) = bias_node.filter(|_| has_bias) {
            grads.register::<B>(node.id, B::affine_bias_gradient(grad.clone()));
        }
        if let Some(node) = weight_node {
            grads.register::<B>(node.id, precision.scope(|| B::affine_weight_gradient(x, grad.clone())));
        }
        if let Some(node) = x_node {
            grads.register::<B>(node.id, precision.scope(|| B::affine_input_gradient(grad, weight)));
        }
    }
}

#[derive(Debug)]
struct Gelu;

impl<B: Kernels> Backward<B, 1> for Gelu {
    type State = FloatTensor<B>;

    fn backward(self, ops: Ops<Self::State, 1>, grads: &mut Gradients, _: &mut Checkpointer) {
        let grad = grads.consume::<B>(&ops.node);
        if let [Some(node)] = ops.parents {
            grads.register::<B>(node.id, B::gelu_erf_backward(ops.state, grad));
        }
    }
}

#[derive(Debug)]
struct Norm;

impl<B: Kernels> Backward<B, 3> for Norm {
    type State = (FloatTensor<B>, FloatTensor<B>, bool, Segments);

    fn backward(self, ops: Ops<Self::State, 3>, grads: &mut Gradients, _: &mut Checkpointer) {
        let [x_node, gamma_node, beta_node] = ops.parents;
        let (x, gamma, has_beta, segments) = ops.state;
        let (shape, parameters) = (x.shape(), gamma.shape());
        let grad = grads.consume::<B>(&ops.node);
        let (by_x, by_gamma, by_beta) = B::norm_backward(x, gamma, has_beta, grad, segments);
        if let Some(node) = x_node {
            grads.register::<B>(node.id, B::float_reshape(by_x, shape));
        }
        if let Some(node) = gamma_node {
            grads.register::<B>(node.id, B::float_reshape(by_gamma, parameters.clone()));
        }
        if let (Some(node), Some(by_beta)) = (beta_node, by_beta) {
            grads.register::<B>(node.id, B::float_reshape(by_beta, parameters));
        }
    }
}

#[derive(Debug)]
struct Attention;

#[derive(Clone, Debug)]
struct AttentionState<B: Kernels> {
    inputs: AttentionInputs<B>,
    out: FloatTensor<B>,
    log_sums: FloatTensor<B>,
    sizes: AttentionSizes,
    /// That of the forward pass.
    precision: MatmulPrecision,
}

impl<B: Kernels> Backward<B, 2> for Attention {
    type State = AttentionState<B>;

    fn backward(self, ops: Ops<Self::State, 2>, grads: &mut Gradients, _: &mut Checkpointer) {
        let [first_node, second_node] = ops.parents;
        let AttentionState { inputs, out, log_sums, sizes, precision } = ops.state;
        let grad = grads.consume::<B>(&ops.node);
        if first_node.is_none() && second_node.is_none() {
            return;
        }
        match precision.scope(|| B::attend_backward(inputs, out, log_sums, grad, sizes)) {
            AttentionInputs::Together(packed) => {
                if let Some(node) = first_node {
                    grads.register::<B>(node.id, packed);
                }
            }
            AttentionInputs::Apart { queries, keys_values } => {
                if let Some(node) = first_node {
                    grads.register::<B>(node.id, queries);
                }
                if let Some(node) = second_node {
                    grads.register::<B>(node.id, keys_values);
                }
            }
        }
    }
}

#[derive(Debug)]
struct Rows;

impl<B: Kernels> Backward<B, 1> for Rows {
    type State = (IntTensor<B>, GatherSizes);

    fn backward(self, ops: Ops<Self::State, 1>, grads: &mut Gradients, _: &mut Checkpointer) {
        let grad = grads.consume::<B>(&ops.node);
        if let [Some(node)] = ops.parents {
            let (indices, sizes) = ops.state;
            grads.register::<B>(node.id, B::rows_backward(grad, indices, sizes));
        }
    }
}

#[derive(Debug)]
struct MaxRows;

impl<B: Kernels> Backward<B, 1> for MaxRows {
    type State = (IntTensor<B>, GatherSizes);

    fn backward(self, ops: Ops<Self::State, 1>, grads: &mut Gradients, _: &mut Checkpointer) {
        let grad = grads.consume::<B>(&ops.node);
        if let [Some(node)] = ops.parents {
            let (winners, sizes) = ops.state;
            grads.register::<B>(node.id, B::max_rows_backward(grad, winners, sizes));
        }
    }
}
