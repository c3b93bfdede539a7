//! Rendering on burn's GPU: tensors are copied within its memory, and only counts are copied to the host.

use std::any::Any;
use std::sync::{Arc, Mutex, MutexGuard, OnceLock, PoisonError};

use atsplat_splat::gpu::{
    GpuError, GpuGaussians, GpuGradients, GpuImageGradients, GpuOptions, GpuPart, GpuRenderer, GpuRendering,
    GpuStripGradients,
};
use atsplat_splat::{SplatError, View, sh_coefficients};
use burn::backend::ops::FloatTensorOps as _;
use burn::backend::tensor::FloatTensor;
use burn::backend::{Cube, CubeDevice, DispatchDevice, TensorMetadata};
use burn::cubecl::wgpu::{AutoCompiler, WgpuServer};
use burn::tensor::wgpu::{WgpuSetup, wgpu};
use burn::tensor::{Device, FloatDType, Shape, Slice};

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
    Device(Option<Arc<GpuGaussians>>),
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
            Ok((gaussians, images)) => (Recorded::Device(Some(Arc::new(gaussians))), images),
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
        let gaussians = match recorded {
            Recorded::Host(recorded) => return host::differentiate::<Self>(&recorded, images, shapes, request),
            Recorded::Device(gaussians) => gaussians,
        };
        let derivatives = gaussians.zip(shared(&images)).and_then(|(gaussians, mut renderer)| {
            derivatives(&mut renderer, &gaussians, &images, shapes, request).ok()
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
) -> Result<(GpuGaussians, FloatTensor<Cube>), SplatError> {
    let gaussians = gaussians(renderer, inputs, request)?;
    let mut render = |view| renderer.render_resident(&gaussians, view, &request.options);
    let pending = request.views.iter().map(&mut render).collect::<Result<Vec<_>, _>>()?;
    let settled = renderer.settle_all(&pending.iter().collect::<Vec<_>>())?;
    let mut census = Vec::new();
    let mut images = Vec::new();
    for (settled, view) in settled.iter().zip(&request.views) {
        census.push(settled.census);
        images.push(image(renderer, settled.result, view, request, &inputs[0])?);
    }
    if census.iter().any(|census| census.invalid > 0) {
        // Values that are not finite are an error, shapes that overflow are skipped: the CPU renderer distinguishes them.
        host::gaussians::<Cube>(inputs.clone(), request)?;
    }
    request.set_outcome(Ok(census));
    Ok((gaussians, Cube::float_cat(images, 0)))
}

#[expect(clippy::expect_used, reason = "a part's buffers are addressed by 32 bits")]
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
            count: u32::try_from(own).expect("parts are smaller than the device's largest buffer"),
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

/// A picture as `[1, height, width, channels]`.
fn image(
    renderer: &GpuRenderer,
    rendering: &GpuRendering,
    view: &View,
    request: &Request,
    like: &FloatTensor<Cube>,
) -> Result<FloatTensor<Cube>, SplatError> {
    let width = view.size.width as usize;
    let shape = [1, view.size.height as usize, width, 4];
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

/// Gradients with respect to the inputs, summed over the views in their order.
fn derivatives(
    renderer: &mut GpuRenderer,
    gaussians: &GpuGaussians,
    images: &FloatTensor<Cube>,
    shapes: &[Shape; INPUTS],
    request: &Request,
) -> Result<Inputs<Cube>, SplatError> {
    let device = images.device();
    let mut pending = Vec::new();
    for (at, view) in request.views.iter().enumerate() {
        let own = Cube::float_slice(images.clone(), &[Slice::from(at..at + 1)]);
        let by_images = image_gradients(renderer, &own, view, request)?;
        pending.push(renderer.backward_resident(gaussians, view, &request.options, &by_images)?);
    }
    let mut sums: Option<Inputs<Cube>> = None;
    for made in renderer.settle_all(&pending.iter().collect::<Vec<_>>())? {
        let own = tensors(renderer, made.result, shapes, &device)?;
        sums = Some(match sums {
            None => own,
            Some(sums) => {
                let mut own = own.into_iter();
                sums.map(|sum| match own.next() {
                    Some(own) => Cube::float_add(sum, own),
                    None => sum,
                })
            }
        });
    }
    let nothing = |shape: &Shape| Cube::float_zeros(shape.clone(), &device, FloatDType::F32);
    Ok(sums.unwrap_or_else(|| shapes.each_ref().map(nothing)))
}

/// Gradients with respect to one image, `[1, height, width, channels]`, strip by strip.
fn image_gradients(
    renderer: &GpuRenderer,
    pixels: &FloatTensor<Cube>,
    view: &View,
    request: &Request,
) -> Result<GpuImageGradients, SplatError> {
    let channels = request.options.channels;
    let colours = flat(channel(pixels.clone(), 0, 4));
    let extras = (channels.depth || channels.scalar).then(|| {
        let nothing = || Cube::float_zeros(channel(pixels.clone(), 0, 1).shape(), &pixels.device(), FloatDType::F32);
        let depth = if channels.depth { channel(pixels.clone(), 4, 1) } else { nothing() };
        let scalar =
            if channels.scalar { channel(pixels.clone(), 4 + usize::from(channels.depth), 1) } else { nothing() };
        flat(Cube::float_cat(vec![depth, scalar, nothing(), nothing()], 3))
    });
    let width = view.size.width as usize;
    let mut copies = Copies::new(renderer);
    let mut strips = Vec::new();
    for [first, rows] in renderer.strips(view)? {
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

/// Copies within the device's memory, in the order of the queue that burn and the renderer share.
struct Copies<'a> {
    renderer: &'a GpuRenderer,
    encoder: wgpu::CommandEncoder,
    /// Memory that burn may neither free nor move until the copies are submitted.
    held: Vec<Box<dyn Any>>,
}

impl<'a> Copies<'a> {
    fn new(renderer: &'a GpuRenderer) -> Self {
        let encoder = renderer.device().create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        Self { renderer, encoder, held: Vec::new() }
    }

    /// Copies numbers of a flat tensor to a new buffer.
    fn out_of(&mut self, tensor: &FloatTensor<Cube>, first: usize, count: usize) -> Result<wgpu::Buffer, SplatError> {
        let bytes = 4 * count as u64;
        let buffer = self.renderer.device().create_buffer(&wgpu::BufferDescriptor {
            label: Some("tensor"),
            size: bytes.max(16),
            usage: wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_DST,
            mapped_at_creation: false,
        });
        let (memory, offset) = self.memory(tensor)?;
        if bytes > 0 {
            self.encoder.copy_buffer_to_buffer(&memory, offset + 4 * first as u64, &buffer, 0, bytes);
        }
        Ok(buffer)
    }

    /// Copies the beginning of a buffer into a contiguous tensor.
    fn fill_tensor(
        &mut self,
        buffer: &wgpu::Buffer,
        tensor: &FloatTensor<Cube>,
        first: usize,
        count: usize,
    ) -> Result<(), SplatError> {
        let (memory, offset) = self.memory(tensor)?;
        if count > 0 {
            self.encoder.copy_buffer_to_buffer(buffer, 0, &memory, offset + 4 * first as u64, 4 * count as u64);
        }
        Ok(())
    }

    /// The buffer of a tensor, and the byte offset of its first number.
    fn memory(&mut self, tensor: &FloatTensor<Cube>) -> Result<(wgpu::Buffer, u64), SplatError> {
        let memory = tensor.client.get_resource::<WgpuServer<AutoCompiler>>(tensor.handle.clone());
        let memory = memory.map_err(|error| self.refused(&error))?;
        let place = (memory.resource().buffer.clone(), memory.resource().offset);
        self.held.push(Box::new(memory));
        Ok(place)
    }

    fn refused(&self, error: &dyn std::fmt::Debug) -> SplatError {
        GpuError::Refused { adapter: self.renderer.adapter().to_owned(), reason: format!("{error:?}") }.into()
    }

    /// Submits the copies after all work that burn queued for a tensor.
    fn submit(self, tensor: &FloatTensor<Cube>) -> Result<(), SplatError> {
        tensor.client.flush().map_err(|error| self.refused(&error))?;
        self.renderer.queue().submit([self.encoder.finish()]);
        Ok(())
    }
}
