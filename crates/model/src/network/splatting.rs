//! The splatter as an operation in burn's graph: Gaussians into images forward, image gradients into gradients backward.

use std::sync::{Arc, Mutex, PoisonError};

use atsplat_splat::cpu::{CpuRenderer, Recording};
use atsplat_splat::{
    Census, GaussianParts, Gaussians, Gradients, ImageGradients, RenderOptions, Rendering, SplatError, View,
};
#[cfg(feature = "gpu-network")]
use burn::backend::Cube;
use burn::backend::autodiff::checkpoint::{base::Checkpointer, strategy::CheckpointStrategy};
use burn::backend::autodiff::grads::Gradients as Graph;
use burn::backend::autodiff::ops::{Backward, Ops, OpsKind};
use burn::backend::tensor::{Device, FloatTensor};
use burn::backend::{Autodiff, Backend, Flex, TensorMetadata, backend_extension};
use burn::tensor::{Shape, TensorData, try_read_sync};

/// Means, quaternions, logarithms of scales, opacity logits, spherical harmonics, scalars.
const INPUTS: usize = 6;

/// Differentiable on `Autodiff`.
#[backend_extension(Cube: cfg(feature = "gpu-network"), Flex, Autodiff)]
pub(super) trait Splatting: Backend {
    /// `[1, Gaussians, …]` each, scalars `[Gaussians]`; into `[views, height, width, channels]`.
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

/// What to render, and what became of it: an operation gives a tensor and nothing else.
#[derive(Debug)]
pub(super) struct Request {
    views: Vec<View>,
    options: RenderOptions,
    sh_degree: u8,
    outcome: Mutex<Option<Result<Vec<Census>, SplatError>>>,
}

impl Request {
    pub(super) const fn new(views: Vec<View>, options: RenderOptions, sh_degree: u8) -> Self {
        Self { views, options, sh_degree, outcome: Mutex::new(None) }
    }

    /// What became of the Gaussians in each view.
    pub(super) fn outcome(&self) -> Result<Vec<Census>, SplatError> {
        self.outcome.lock().unwrap_or_else(PoisonError::into_inner).take().unwrap_or_else(|| Ok(Vec::new()))
    }

    fn gaussians<B: Backend>(&self, inputs: [FloatTensor<B>; INPUTS]) -> Result<Gaussians, SplatError> {
        let [means, quaternions, log_scales, opacity_logits, sh, scalars] = inputs.map(numbers::<B>);
        Gaussians::new(GaussianParts {
            means: means.as_chunks().0.to_vec(),
            quaternions: quaternions.as_chunks().0.to_vec(),
            log_scales: log_scales.as_chunks().0.to_vec(),
            opacity_logits,
            sh_degree: self.sh_degree,
            sh: sh.as_chunks().0.to_vec(),
            scalars: self.options.channels.scalar.then_some(scalars),
            filter_3d: None,
        })
    }

    fn render(&self, gaussians: Result<Gaussians, SplatError>) -> Vec<f32> {
        let render = |gaussians| CpuRenderer::default().render_many(&gaussians, &self.views, &self.options);
        let rendered = gaussians.and_then(render);
        self.finish(rendered.map(|images| images.iter().map(|image| (image.census, self.interleaved(image))).unzip()))
    }

    fn record(&self, gaussians: Result<Gaussians, SplatError>) -> (Vec<Recorded>, Vec<f32>) {
        let recorded = gaussians.and_then(|gaussians| {
            let gaussians = Arc::new(gaussians);
            let mut renderer = CpuRenderer::default();
            let record = |view| renderer.record(Arc::clone(&gaussians), view, &self.options);
            self.views.iter().map(record).collect::<Result<Vec<Recorded>, SplatError>>()
        });
        match recorded {
            Ok(recordings) => {
                let images = recordings.iter().map(Recording::rendering);
                let images = images.map(|image| (image.census, self.interleaved(image))).unzip();
                (recordings, self.finish(Ok(images)))
            }
            Err(error) => (Vec::new(), self.finish(Err(error))),
        }
    }

    /// Notes the outcome; zeros where there is no image.
    fn finish(&self, images: Result<(Vec<Census>, Vec<Vec<f32>>), SplatError>) -> Vec<f32> {
        let (outcome, images) = match images {
            Ok((census, images)) => (Ok(census), images.concat()),
            Err(error) => (Err(error), vec![0.0; self.shape().iter().product()]),
        };
        *self.outcome.lock().unwrap_or_else(PoisonError::into_inner) = Some(outcome);
        images
    }

    /// Colour, alpha, then depth and scalar where asked for.
    fn channels(&self) -> usize {
        4 + usize::from(self.options.channels.depth) + usize::from(self.options.channels.scalar)
    }

    fn shape(&self) -> [usize; 4] {
        let size = self.views.first().map(|view| view.size);
        let [height, width] = size.map_or([0, 0], |size| [size.height as usize, size.width as usize]);
        [self.views.len(), height, width, self.channels()]
    }

    fn interleaved(&self, image: &Rendering<f32>) -> Vec<f32> {
        let mut pixels = Vec::with_capacity(image.alpha.len() * self.channels());
        for (at, (rgb, alpha)) in image.rgb.iter().zip(&image.alpha).enumerate() {
            pixels.extend(rgb);
            pixels.push(*alpha);
            let extra = [&image.depth, &image.scalar].into_iter().flatten();
            pixels.extend(extra.filter_map(|image| image.get(at)));
        }
        pixels
    }

    /// Derivatives by the images of one view.
    fn image_gradients(&self, pixels: &[f32]) -> ImageGradients<f32> {
        let pixels = || pixels.chunks_exact(self.channels());
        let channel =
            |at: usize| pixels().map(|pixel| pixel.get(at).copied().unwrap_or_default()).collect::<Vec<f32>>();
        let depth = self.options.channels.depth;
        ImageGradients {
            rgb: pixels().filter_map(|pixel| pixel.first_chunk().copied()).collect(),
            alpha: Some(channel(3)),
            depth: depth.then(|| channel(4)),
            scalar: self.options.channels.scalar.then(|| channel(4 + usize::from(depth))),
        }
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
                let device = means.device();
                let gaussians =
                    request.gaussians::<Self>([means, quaternions, log_scales, opacity_logits, sh, scalars]);
                tensor::<Self>(request.render(gaussians), request.shape(), &device)
            }
        }
    };
}

without_gradients!(Flex);
#[cfg(feature = "gpu-network")]
without_gradients!(Cube);

impl<B: Backend, C: CheckpointStrategy> Splatting for Autodiff<B, C> {
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
        let [means, ..] = &inputs;
        let device = means.device();
        let shapes = inputs.each_ref().map(TensorMetadata::shape);
        let gaussians = request.gaussians::<B>(inputs);
        match Splat.prepare::<C>(nodes).compute_bound().stateful() {
            OpsKind::Tracked(prepared) => {
                let (recordings, images) = request.record(gaussians);
                let images = tensor::<B>(images, request.shape(), &device);
                prepared.finish(State { recordings: Arc::new(Mutex::new(recordings)), shapes, request }, images)
            }
            OpsKind::UnTracked(prepared) => {
                prepared.finish(tensor::<B>(request.render(gaussians), request.shape(), &device))
            }
        }
    }
}

/// Gaussians are shared by the recordings of all views.
type Recorded = Recording<Arc<Gaussians>>;

/// What the backward pass needs again.
#[derive(Clone, Debug)]
struct State {
    recordings: Arc<Mutex<Vec<Recorded>>>,
    shapes: [Shape; INPUTS],
    request: Arc<Request>,
}

#[derive(Debug)]
struct Splat;

impl<B: Backend> Backward<B, INPUTS> for Splat {
    type State = State;

    fn backward(self, ops: Ops<Self::State, INPUTS>, grads: &mut Graph, _: &mut Checkpointer) {
        let State { recordings, shapes, request } = ops.state;
        let grad = grads.consume::<B>(&ops.node);
        let device = grad.device();
        let pixels = numbers::<B>(grad);
        let mut recordings = recordings.lock().unwrap_or_else(PoisonError::into_inner);
        let per_view = request.shape().iter().skip(1).product::<usize>().max(1);
        let mut sums: [Vec<f32>; INPUTS] = Default::default();
        let mut failed = recordings.is_empty();
        // Views are added up in their order.
        for (recording, pixels) in recordings.iter_mut().zip(pixels.chunks_exact(per_view)) {
            match recording.backward(&request.image_gradients(pixels)) {
                Ok(gradients) => add(&mut sums, gradients),
                Err(_) => failed = true,
            }
        }
        for ((node, sum), shape) in ops.parents.into_iter().zip(sums).zip(shapes) {
            let Some(node) = node else { continue };
            let sum = match (failed, sum.is_empty()) {
                (true, _) => vec![f32::NAN; shape.num_elements()],
                // No scalars were rendered, so nothing depends on them.
                (false, true) => vec![0.0; shape.num_elements()],
                (false, false) => sum,
            };
            grads.register::<B>(node.id, B::float_from_data(TensorData::new(sum, shape), &device));
        }
    }
}

fn add(sums: &mut [Vec<f32>; INPUTS], gradients: Gradients<f32>) {
    let Gradients { means, quaternions, log_scales, opacity_logits, sh, scalars, .. } = gradients;
    let parts = [
        means.into_flattened(),
        quaternions.into_flattened(),
        log_scales.into_flattened(),
        opacity_logits,
        sh.into_flattened(),
        scalars,
    ];
    for (sum, part) in sums.iter_mut().zip(parts) {
        if sum.is_empty() {
            *sum = part;
        } else {
            sum.iter_mut().zip(part).for_each(|(sum, part)| *sum += part);
        }
    }
}

fn tensor<B: Backend>(values: Vec<f32>, shape: [usize; 4], device: &Device<B>) -> FloatTensor<B> {
    B::float_from_data(TensorData::new(values, shape), device)
}

/// The tensor's numbers, row-major; none where a device failed.
fn numbers<B: Backend>(tensor: FloatTensor<B>) -> Vec<f32> {
    let data = try_read_sync(B::float_into_data(tensor)).and_then(Result::ok);
    data.and_then(|data| data.convert::<f32>().try_into_vec().ok()).unwrap_or_default()
}
