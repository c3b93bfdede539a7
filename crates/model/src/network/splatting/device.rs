//! Rendering on burn's GPU: tensors are copied within its memory, and only counts are copied to the host.

use std::sync::{Arc, Mutex, MutexGuard, OnceLock, PoisonError};

use atsplat_splat::gpu::{
    GpuCounts, GpuError, GpuGaussians, GpuGradients, GpuImageGradients, GpuOptions, GpuPart, GpuRenderer, GpuRendering,
    GpuStripGradients,
};
use atsplat_splat::{GaussianCounts, SplatError, sh_coefficients};
use burn::backend::ops::FloatTensorOps as _;
use burn::backend::tensor::FloatTensor;
use burn::backend::{Cube, CubeDevice, DispatchDevice, TensorMetadata};
use burn::tensor::wgpu::WgpuSetup;
use burn::tensor::{Device, FloatDType, Shape, Slice};

use super::copies::Copies;
use super::{INPUTS, Inputs, Request, Splatter, host};

/// The renderer that shares burn's device, or why there is none.
static SHARED: OnceLock<Result<Shared, String>> = OnceLock::new();

struct Shared {
    device: CubeDevice,
    renderer: Mutex<GpuRenderer>,
}

/// Opens a renderer on burn's device, if it passes its self-test there.
pub(in crate::network) fn share(device: &Device, setup: &WgpuSetup) {
    let open = || {
        let DispatchDevice::Cube(device) = device.as_dispatch() else {
            return Err("the device is not a GPU".to_owned());
        };
        let (own, queue) = (setup.device.clone(), setup.queue.clone());
        let opened = GpuRenderer::with_device(own, queue, GpuOptions::default());
        let mut renderer = opened.map_err(|error| error.to_string())?;
        renderer.self_test().map_err(|error| error.to_string())?;
        renderer.free_buffers();
        Ok(Shared { device: device.clone(), renderer: Mutex::new(renderer) })
    };
    SHARED.get_or_init(open);
}

/// Whether a renderer shares burn's device.
pub(in crate::network) fn is_shared() -> bool {
    SHARED.get().is_some_and(Result::is_ok)
}

/// What passed between the host and the device in renderings, if a renderer shares burn's device.
pub(in crate::network) fn counts() -> Option<GpuCounts> {
    let shared = SHARED.get()?.as_ref().ok()?;
    Some(shared.renderer.lock().unwrap_or_else(PoisonError::into_inner).counts())
}

/// Why no renderer shares burn's device, if opening one failed.
pub(in crate::network) fn refusal() -> Option<String> {
    SHARED.get().and_then(|shared| shared.as_ref().err().cloned())
}

/// The renderer of a tensor's device.
fn shared(tensor: &FloatTensor<Cube>) -> Option<MutexGuard<'static, GpuRenderer>> {
    let shared = SHARED.get()?.as_ref().ok().filter(|shared| shared.device == tensor.device())?;
    Some(shared.renderer.lock().unwrap_or_else(PoisonError::into_inner))
}

/// What the backward pass needs.
#[derive(Clone, Debug)]
pub(in crate::network) enum Recorded {
    Host(host::Recorded),
    /// `None` if rendering failed.
    Device(Option<Arc<[Scenes]>>),
}

/// The copy of consecutive scenes, which one launch renders.
#[derive(Clone, Debug)]
pub(in crate::network) struct Scenes {
    gaussians: GpuGaussians,
    count: usize,
}

impl Splatter for Cube {
    type Recorded = Recorded;

    fn render(inputs: Inputs<Self>, request: &Request) -> FloatTensor<Self> {
        Self::record(inputs, request).1
    }

    fn record(inputs: Inputs<Self>, request: &Request) -> (Recorded, FloatTensor<Self>) {
        let device = inputs[0].device();
        let Some(mut renderer) = shared(&inputs[0]) else {
            let (recorded, images) = host::record::<Self>(inputs, request);
            return (Recorded::Host(recorded), images);
        };
        match rendered(&mut renderer, &inputs, request) {
            Ok((scenes, images)) => (Recorded::Device(Some(scenes.into())), images),
            Err(error) => {
                request.set_outcome(Err(error));
                let nothing = Self::float_zeros(Shape::from(request.shape()), &device, FloatDType::F32);
                (Recorded::Device(None), nothing)
            }
        }
    }

    fn differentiate(
        recorded: Recorded,
        images: FloatTensor<Self>,
        shapes: &[Shape; INPUTS],
        request: &Request,
    ) -> Inputs<Self> {
        let device = images.device();
        let scenes = match recorded {
            Recorded::Host(recorded) => return host::differentiate::<Self>(&recorded, images, shapes, request),
            Recorded::Device(scenes) => scenes,
        };
        let derivatives = scenes.zip(shared(&images)).and_then(|(scenes, mut renderer)| {
            let made = derivatives(&mut renderer, &scenes, &images, shapes, request);
            made.inspect_err(|error| tracing::error!(%error, "no gradients of a rendering")).ok()
        });
        let unknown = |shape: &Shape| Self::float_full(shape.clone(), f32::NAN.into(), &device, FloatDType::F32);
        derivatives.unwrap_or_else(|| shapes.each_ref().map(unknown))
    }
}

/// Renders every view; the Gaussians' buffers are kept for the backward pass.
fn rendered(
    renderer: &mut GpuRenderer,
    inputs: &Inputs<Cube>,
    request: &Request,
) -> Result<(Vec<Scenes>, FloatTensor<Cube>), SplatError> {
    let splats = inputs[0].shape().num_elements() / 3 / request.scenes.max(1) * request.views.len();
    let done = match request.scenes {
        // What is too large for one launch is rendered scene by scene. The backward pass needs room for a few tiles of each splat.
        scenes if scenes == 1 || 2 * splats > renderer.part_length(request.sh_degree) => None,
        scenes => match batch(renderer, inputs, scenes, request) {
            Err(SplatError::Gpu(GpuError::TooLarge { .. }) | SplatError::Memory { .. }) => None,
            done => Some(done?),
        },
    };
    let (scenes, counts, images) = match done {
        Some(done) => done,
        None => one_by_one(renderer, inputs, request)?,
    };
    request.set_outcome(Ok(counts));
    Ok((scenes, images))
}

/// Copies of the Gaussians, counts, and images.
type Rendered = (Vec<Scenes>, Vec<GaussianCounts>, FloatTensor<Cube>);

/// All scenes by one launch of each kernel.
fn batch(
    renderer: &mut GpuRenderer,
    inputs: &Inputs<Cube>,
    scenes: usize,
    request: &Request,
) -> Result<Rendered, SplatError> {
    let gaussians = gaussians(renderer, inputs, request)?;
    let pending = renderer.render_batch(&gaussians, in_u32(scenes), &request.views, &request.options)?;
    let settled = renderer.settle(&pending)?;
    let (counts, result) = (settled.counts, settled.result);
    let images = image(renderer, result, request.views.len(), request, &inputs[0])?;
    Ok((vec![Scenes { gaussians, count: scenes }], vec![counts], images))
}

/// Each view by its own launches, with one wait for a scene.
fn one_by_one(renderer: &mut GpuRenderer, inputs: &Inputs<Cube>, request: &Request) -> Result<Rendered, SplatError> {
    let (mut scenes, mut counts, mut images) = (Vec::new(), Vec::new(), Vec::new());
    for (at, views) in request.views_by_scene().enumerate() {
        let row = |input: &FloatTensor<Cube>| Cube::float_slice(input.clone(), &[Slice::from(at..at + 1)]);
        let gaussians = match request.scenes {
            1 => gaussians(renderer, inputs, request)?,
            _ => gaussians(renderer, &inputs.each_ref().map(row), request)?,
        };
        let mut render = |view| renderer.render_resident(&gaussians, view, &request.options);
        let pending = views.iter().map(&mut render).collect::<Result<Vec<_>, _>>()?;
        for settled in renderer.settle_all(&pending.iter().collect::<Vec<_>>())? {
            counts.push(settled.counts);
            images.push(image(renderer, settled.result, 1, request, &inputs[0])?);
        }
        scenes.push(Scenes { gaussians, count: 1 });
    }
    Ok((scenes, counts, Cube::float_cat(images, 0)))
}

#[expect(clippy::expect_used, reason = "an adapter holds fewer")]
fn in_u32(count: usize) -> u32 {
    u32::try_from(count).expect("fewer scenes and Gaussians than 32 bits can count")
}

fn gaussians(renderer: &GpuRenderer, inputs: &Inputs<Cube>, request: &Request) -> Result<GpuGaussians, SplatError> {
    let count = inputs[0].shape().num_elements() / 3;
    let stored = 3 * sh_coefficients(request.sh_degree);
    let [means, quaternions, log_scales, opacity_logits, sh, scalars] = inputs.clone().map(flat);
    let mut copies = Copies::new(renderer);
    let most = renderer.part_length(request.sh_degree);
    let mut parts = Vec::new();
    for first in (0..count).step_by(most) {
        let own = most.min(count - first);
        let mut rows = |tensor: &FloatTensor<Cube>, each: usize| copies.out_of(tensor, first * each, own * each);
        parts.push(GpuPart {
            count: in_u32(own),
            means: rows(&means, 3)?,
            quaternions: rows(&quaternions, 4)?,
            log_scales: rows(&log_scales, 3)?,
            opacity_logits: rows(&opacity_logits, 1)?,
            sh: rows(&sh, stored)?,
            scalars: request.options.channels.scalar.then(|| rows(&scalars, 1)).transpose()?,
            filter_3d: None,
        });
    }
    copies.submit(&means)?;
    GpuGaussians::from_parts(parts, request.sh_degree)
}

/// Images as `[images, height, width, channels]`.
fn image(
    renderer: &GpuRenderer,
    rendering: &GpuRendering,
    images: usize,
    request: &Request,
    like: &FloatTensor<Cube>,
) -> Result<FloatTensor<Cube>, SplatError> {
    let [_, height, width, _] = request.shape();
    let shape = [images, height, width, 4];
    let empty = || Cube::float_empty(Shape::from(shape), &like.device(), FloatDType::F32);
    let channels = request.options.channels;
    let colours = empty();
    let extras = (channels.depth || channels.scalar).then(empty);
    let mut copies = Copies::new(renderer);
    for strip in &rendering.strips {
        let (first, length) = (4 * strip.first_row as usize * width, 4 * strip.rows as usize * width);
        copies.fill_tensor(&strip.colours, &colours, first, length)?;
        if let Some((buffer, tensor)) = strip.extras.as_ref().zip(extras.as_ref()) {
            copies.fill_tensor(buffer, tensor, first, length)?;
        }
    }
    copies.submit(like)?;
    let mut parts = vec![colours];
    if let Some(extras) = extras {
        let wanted = [(channels.depth, 0), (channels.scalar, 1)];
        parts.extend(wanted.into_iter().filter(|(wanted, _)| *wanted).map(|(_, at)| channel(extras.clone(), at, 1)));
    }
    Ok(if parts.len() > 1 { Cube::float_cat(parts, 3) } else { parts.swap_remove(0) })
}

/// Gradients with respect to the inputs, summed over the views of each scene in their order.
fn derivatives(
    renderer: &mut GpuRenderer,
    scenes: &[Scenes],
    images: &FloatTensor<Cube>,
    shapes: &[Shape; INPUTS],
    request: &Request,
) -> Result<Inputs<Cube>, SplatError> {
    let (gaussians, count) = match scenes {
        [Scenes { gaussians, count }] if *count > 1 => (gaussians, *count),
        _ => return derivatives_one_by_one(renderer, scenes, images, shapes, request),
    };
    let by_images = image_gradients(renderer, images, request)?;
    let made = renderer.backward_batch(gaussians, in_u32(count), &request.views, &request.options, &by_images);
    let settled = made.and_then(|made| {
        let settled = renderer.settle(&made)?;
        tensors(renderer, settled.result, shapes, &images.device())
    });
    match settled {
        // A pair of the backward pass takes six times the memory of a pair of the forward pass, which fitted.
        Err(SplatError::Gpu(GpuError::TooLarge { .. }) | SplatError::Memory { .. }) => {
            let scenes = separated(renderer, gaussians, count, images)?;
            derivatives_one_by_one(renderer, &scenes, images, shapes, request)
        }
        made => made,
    }
}

/// The scenes of a batch, each in buffers of its own.
fn separated(
    renderer: &GpuRenderer,
    batch: &GpuGaussians,
    count: usize,
    like: &FloatTensor<Cube>,
) -> Result<Vec<Scenes>, SplatError> {
    let stored = 3 * sh_coefficients(batch.sh_degree());
    let mut copies = Copies::new(renderer);
    let mut scenes = Vec::with_capacity(count);
    for at in 0..count {
        let own = |part: &GpuPart| {
            let gaussians = part.count as usize / count;
            let mut rows = |buffer, each: usize| copies.of_buffer(buffer, at * gaussians * each, gaussians * each);
            GpuPart {
                count: in_u32(gaussians),
                means: rows(&part.means, 3),
                quaternions: rows(&part.quaternions, 4),
                log_scales: rows(&part.log_scales, 3),
                opacity_logits: rows(&part.opacity_logits, 1),
                sh: rows(&part.sh, stored),
                scalars: part.scalars.as_ref().map(|scalars| rows(scalars, 1)),
                filter_3d: None,
            }
        };
        let parts = batch.parts().iter().map(own).collect();
        scenes.push(Scenes { gaussians: GpuGaussians::from_parts(parts, batch.sh_degree())?, count: 1 });
    }
    copies.submit(like)?;
    Ok(scenes)
}

fn derivatives_one_by_one(
    renderer: &mut GpuRenderer,
    scenes: &[Scenes],
    images: &FloatTensor<Cube>,
    shapes: &[Shape; INPUTS],
    request: &Request,
) -> Result<Inputs<Cube>, SplatError> {
    let device = images.device();
    let of_scene = |shape: &Shape| std::iter::once(1).chain(shape.iter().skip(1).copied()).collect::<Shape>();
    let of_scene = shapes.each_ref().map(of_scene);
    let mut views = request.views.iter().enumerate();
    let mut by_scene: Vec<Inputs<Cube>> = Vec::new();
    for (Scenes { gaussians, .. }, own) in scenes.iter().zip(request.views_by_scene()) {
        let mut pending = Vec::new();
        for (at, view) in views.by_ref().take(own.len()) {
            let image = Cube::float_slice(images.clone(), &[Slice::from(at..at + 1)]);
            let by_images = image_gradients(renderer, &image, request)?;
            pending.push(renderer.backward_resident(gaussians, view, &request.options, &by_images)?);
        }
        let settled = renderer.settle_all(&pending.iter().collect::<Vec<_>>())?;
        let made = settled.iter().map(|made| tensors(renderer, made.result, &of_scene, &device));
        by_scene.push(summed(made.collect::<Result<_, _>>()?, &of_scene, &device));
    }
    Ok(if by_scene.len() == 1 { by_scene.swap_remove(0) } else { joined(&by_scene) })
}

fn summed(all: Vec<Inputs<Cube>>, shapes: &[Shape; INPUTS], device: &CubeDevice) -> Inputs<Cube> {
    let sum = all.into_iter().reduce(|sums, own| {
        let mut own = own.into_iter();
        sums.map(|sum| match own.next() {
            Some(own) => Cube::float_add(sum, own),
            None => sum,
        })
    });
    sum.unwrap_or_else(|| shapes.each_ref().map(|shape| Cube::float_zeros(shape.clone(), device, FloatDType::F32)))
}

/// Scenes one after the other.
fn joined(scenes: &[Inputs<Cube>]) -> Inputs<Cube> {
    std::array::from_fn(|input| Cube::float_cat(scenes.iter().map(|scene| scene[input].clone()).collect(), 0))
}

/// Gradients with respect to images, `[images, height, width, channels]`: of one, strip by strip, or of a batch.
fn image_gradients(
    renderer: &GpuRenderer,
    pixels: &FloatTensor<Cube>,
    request: &Request,
) -> Result<GpuImageGradients, SplatError> {
    let channels = request.options.channels;
    let [images, height, width] = [0, 1, 2].map(|dim| pixels.shape()[dim]);
    let colours = flat(channel(pixels.clone(), 0, 4));
    let extras = (channels.depth || channels.scalar).then(|| {
        let nothing = || Cube::float_zeros(channel(pixels.clone(), 0, 1).shape(), &pixels.device(), FloatDType::F32);
        let depth = if channels.depth { channel(pixels.clone(), 4, 1) } else { nothing() };
        let scalar =
            if channels.scalar { channel(pixels.clone(), 4 + usize::from(channels.depth), 1) } else { nothing() };
        flat(Cube::float_cat(vec![depth, scalar, nothing(), nothing()], 3))
    });
    let rows = match request.views.first() {
        Some(view) if images == 1 => renderer.strips(view)?,
        _ => vec![[0, in_u32(images * height)]],
    };
    let mut copies = Copies::new(renderer);
    let mut strips = Vec::new();
    for [first, rows] in rows {
        let (first, length) = (4 * first as usize * width, 4 * rows as usize * width);
        strips.push(GpuStripGradients {
            colours: copies.out_of(&colours, first, length)?,
            extras: extras.as_ref().map(|extras| copies.out_of(extras, first, length)).transpose()?,
        });
    }
    copies.submit(&colours)?;
    Ok(GpuImageGradients { strips })
}

/// Gradients as burn's tensors.
fn tensors(
    renderer: &GpuRenderer,
    made: &GpuGradients,
    shapes: &[Shape; INPUTS],
    device: &CubeDevice,
) -> Result<Inputs<Cube>, SplatError> {
    // Without rendered scalars, their gradient is zero.
    let zeros = |shape: &Shape| Cube::float_zeros(shape.clone(), device, FloatDType::F32);
    let tensors: Inputs<Cube> = shapes.each_ref().map(zeros);
    let mut copies = Copies::new(renderer);
    let mut first = 0;
    for part in &made.parts {
        let count = part.count as usize;
        let stored = 3 * sh_coefficients(made.sh_degree);
        let fields = [
            (Some(&part.means), 3),
            (Some(&part.quaternions), 4),
            (Some(&part.log_scales), 3),
            (Some(&part.opacity_logits), 1),
            (Some(&part.sh), stored),
            (part.scalars.as_ref(), 1),
        ];
        for ((buffer, each), tensor) in fields.into_iter().zip(&tensors) {
            if let Some(buffer) = buffer {
                copies.fill_tensor(buffer, tensor, first * each, count * each)?;
            }
        }
        first += count;
    }
    copies.submit(&tensors[0])?;
    Ok(tensors)
}

/// Some channels of `[…, channels]`.
fn channel(pixels: FloatTensor<Cube>, first: usize, count: usize) -> FloatTensor<Cube> {
    let [views, height, width] = [0, 1, 2].map(|dim| pixels.shape()[dim]);
    Cube::float_slice(
        pixels,
        &[(0..views).into(), (0..height).into(), (0..width).into(), (first..first + count).into()],
    )
}

/// A tensor flattened to one dimension.
fn flat(tensor: FloatTensor<Cube>) -> FloatTensor<Cube> {
    let count = tensor.shape().num_elements();
    Cube::float_reshape(tensor, Shape::from([count]))
}
