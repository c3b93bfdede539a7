//! The renderer as an operation in burn's graph: Gaussians to images forward, image gradients to Gaussian gradients backward.

#[cfg(feature = "gpu-network")]
mod copies;
#[cfg(feature = "gpu-network")]
mod device;
mod host;

use std::sync::{Arc, Mutex, PoisonError};

use atsplat_splat::{GaussianCounts, RenderOptions, SplatError, View};
#[cfg(feature = "gpu-network")]
use burn::backend::Cube;
use burn::backend::autodiff::checkpoint::{base::Checkpointer, strategy::CheckpointStrategy};
use burn::backend::autodiff::grads::Gradients as Graph;
use burn::backend::autodiff::ops::{Backward, Ops, OpsKind};
use burn::backend::tensor::FloatTensor;
use burn::backend::{Autodiff, Backend, Flex, TensorMetadata, backend_extension};
use burn::tensor::Shape;
#[cfg(feature = "gpu-network")]
pub(super) use device::{counts, is_shared, render_error, share};

/// Number of inputs: means, quaternions, log scales, opacity logits, spherical harmonics, scalars.
const INPUTS: usize = 6;

type Inputs<B> = [FloatTensor<B>; INPUTS];

/// The operation, differentiable on `Autodiff`.
#[backend_extension(Cube: cfg(feature = "gpu-network"), Flex, Autodiff)]
pub(super) trait Splatting: Backend {
    /// Inputs are `[scenes, Gaussians, …]`, scalars `[scenes, Gaussians]`; the output is `[views, height, width, channels]`.
    fn splat(
        means: FloatTensor<Self>,
        quaternions: FloatTensor<Self>,
        log_scales: FloatTensor<Self>,
        opacity_logits: FloatTensor<Self>,
        sh: FloatTensor<Self>,
        scalars: FloatTensor<Self>,
        request: Arc<Request>,
    ) -> FloatTensor<Self>;
}

/// A backend whose tensors are rendered, forward and backward.
pub(super) trait RenderBackend: Backend {
    /// What the backward pass needs.
    type Recorded: Clone + std::fmt::Debug + Send + 'static;

    /// Renders images.
    fn render(inputs: Inputs<Self>, request: &Request) -> FloatTensor<Self>;

    /// Renders images and records what the backward pass needs.
    fn record(inputs: Inputs<Self>, request: &Request) -> (Self::Recorded, FloatTensor<Self>);

    /// Gradients with respect to inputs of these shapes from those with respect to images; NaN if they cannot be computed, of which
    /// the request keeps the reason.
    fn differentiate(
        recorded: Self::Recorded,
        images: FloatTensor<Self>,
        shapes: &[Shape; INPUTS],
        request: &Request,
    ) -> Inputs<Self>;
}

/// What to render, and the outcomes, since an operation can return only tensors.
#[derive(Debug)]
pub(super) struct Request {
    /// The same number for every scene, those of the first scene first.
    views: Vec<View>,
    scenes: usize,
    options: RenderOptions,
    sh_degree: u8,
    outcome: Mutex<Option<Result<Vec<GaussianCounts>, SplatError>>>,
    /// Why the backward pass failed.
    backward_failure: Mutex<Option<String>>,
}

impl Request {
    pub(super) const fn new(views: Vec<View>, scenes: usize, options: RenderOptions, sh_degree: u8) -> Self {
        Self { views, scenes, options, sh_degree, outcome: Mutex::new(None), backward_failure: Mutex::new(None) }
    }

    /// The views of each scene.
    fn views_by_scene(&self) -> impl Iterator<Item = &[View]> {
        self.views.chunks((self.views.len() / self.scenes.max(1)).max(1))
    }

    /// Counts of the Gaussians in each view, or in all of them.
    #[expect(clippy::expect_used, reason = "every implementation of the operation sets the outcome")]
    pub(super) fn outcome(&self) -> Result<Vec<GaussianCounts>, SplatError> {
        self.outcome.lock().unwrap_or_else(PoisonError::into_inner).take().expect("the outcome of a rendering")
    }

    fn set_outcome(&self, outcome: Result<Vec<GaussianCounts>, SplatError>) {
        *self.outcome.lock().unwrap_or_else(PoisonError::into_inner) = Some(outcome);
    }

    /// Why the backward pass failed, if it has run and did.
    pub(super) fn backward_failure(&self) -> Option<String> {
        self.backward_failure.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    fn set_backward_failure(&self, reason: String) {
        *self.backward_failure.lock().unwrap_or_else(PoisonError::into_inner) = Some(reason);
    }

    /// Number of channels: colour, alpha, then depth and scalar if requested.
    fn channels(&self) -> usize {
        4 + usize::from(self.options.channels.depth) + usize::from(self.options.channels.scalar)
    }

    fn shape(&self) -> [usize; 4] {
        let size = self.views.first().map(|view| view.size);
        let [height, width] = size.map_or([0, 0], |size| [size.height as usize, size.width as usize]);
        [self.views.len(), height, width, self.channels()]
    }
}

macro_rules! without_gradients {
    ($backend:ty) => {
        impl Splatting for $backend {
            fn splat(
                means: FloatTensor<Self>,
                quaternions: FloatTensor<Self>,
                log_scales: FloatTensor<Self>,
                opacity_logits: FloatTensor<Self>,
                sh: FloatTensor<Self>,
                scalars: FloatTensor<Self>,
                request: Arc<Request>,
            ) -> FloatTensor<Self> {
                Self::render([means, quaternions, log_scales, opacity_logits, sh, scalars], &request)
            }
        }
    };
}

without_gradients!(Flex);
#[cfg(feature = "gpu-network")]
without_gradients!(Cube);

impl<B: RenderBackend, C: CheckpointStrategy> Splatting for Autodiff<B, C> {
    fn splat(
        means: FloatTensor<Self>,
        quaternions: FloatTensor<Self>,
        log_scales: FloatTensor<Self>,
        opacity_logits: FloatTensor<Self>,
        sh: FloatTensor<Self>,
        scalars: FloatTensor<Self>,
        request: Arc<Request>,
    ) -> FloatTensor<Self> {
        let nodes =
            [means.node(), quaternions.node(), log_scales.node(), opacity_logits.node(), sh.node(), scalars.node()];
        let inputs = [means, quaternions, log_scales, opacity_logits, sh, scalars];
        let inputs = inputs.map(|input| input.primitive().clone());
        let shapes = inputs.each_ref().map(TensorMetadata::shape);
        match Splat.prepare::<C>(nodes).compute_bound().stateful() {
            OpsKind::Tracked(prepared) => {
                let (recorded, images) = B::record(inputs, &request);
                prepared.finish(State::<B> { recorded, shapes, request }, images)
            }
            OpsKind::UnTracked(prepared) => prepared.finish(B::render(inputs, &request)),
        }
    }
}

/// What the backward pass needs.
#[derive(Clone, Debug)]
struct State<B: RenderBackend> {
    recorded: B::Recorded,
    shapes: [Shape; INPUTS],
    request: Arc<Request>,
}

#[derive(Debug)]
struct Splat;

impl<B: RenderBackend> Backward<B, INPUTS> for Splat {
    type State = State<B>;

    fn backward(self, ops: Ops<Self::State, INPUTS>, grads: &mut Graph, _: &mut Checkpointer) {
        let State { recorded, shapes, request } = ops.state;
        let images = grads.consume::<B>(&ops.node);
        let derivatives = B::differentiate(recorded, images, &shapes, &request);
        for (node, derivative) in ops.parents.into_iter().zip(derivatives) {
            let Some(node) = node else { continue };
            grads.register::<B>(node.id, derivative);
        }
    }
}
