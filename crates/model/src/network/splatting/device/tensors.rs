//! Between burn's tensors and the renderer's buffers.

use atsplat_splat::gpu::{
    GpuGaussians, GpuGradients, GpuImageGradients, GpuPart, GpuRenderer, GpuRendering, GpuStripGradients,
};
use atsplat_splat::{SplatError, sh_coefficients};
use burn::backend::ops::FloatTensorOps as _;
use burn::backend::tensor::FloatTensor;
use burn::backend::{Cube, CubeDevice, TensorMetadata as _};
use burn::tensor::{FloatDType, Shape};

use super::super::copies::Copies;
use super::super::{INPUTS, Inputs, Request};

/// The Gaussians of all scenes in buffers of the renderer.
pub(super) fn gaussians_of(
    renderer: &GpuRenderer,
    inputs: &Inputs<Cube>,
    request: &Request,
) -> Result<GpuGaussians, SplatError> {
    let count = inputs[0].shape().num_elements() / 3;
    let stored = 3 * sh_coefficients(request.sh_degree);
    let [means, quaternions, log_scales, opacity_logits, sh, scalars] = inputs.clone().map(flat);
    let mut copies = Copies::new(renderer)?;
    let most = renderer.part_length(request.sh_degree);
    let mut parts = Vec::new();
    for first in (0..count).step_by(most) {
        let length = most.min(count - first);
        let mut rows = |tensor: &FloatTensor<Cube>, each: usize| copies.out_of(tensor, first * each, length * each);
        parts.push(GpuPart {
            count: in_u32(length),
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

/// Images as `[images, height, width, channels]`, on the device of a tensor.
pub(super) fn image_tensor(
    renderer: &GpuRenderer,
    rendering: &GpuRendering,
    images: usize,
    request: &Request,
    device_of: &FloatTensor<Cube>,
) -> Result<FloatTensor<Cube>, SplatError> {
    let [_, height, width, _] = request.shape();
    let shape = [images, height, width, 4];
    let empty = || Cube::float_empty(Shape::from(shape), &device_of.device(), FloatDType::F32);
    let channels = request.options.channels;
    let colours = empty();
    let extras = (channels.depth || channels.scalar).then(empty);
    let mut copies = Copies::new(renderer)?;
    for strip in &rendering.strips {
        let (first, length) = (4 * strip.first_row as usize * width, 4 * strip.rows as usize * width);
        copies.fill_tensor(&strip.colours, &colours, first, length)?;
        if let Some((buffer, tensor)) = strip.extras.as_ref().zip(extras.as_ref()) {
            copies.fill_tensor(buffer, tensor, first, length)?;
        }
    }
    copies.submit(device_of)?;
    let mut parts = vec![colours];
    if let Some(extras) = extras {
        let wanted = [(channels.depth, 0), (channels.scalar, 1)];
        parts.extend(wanted.into_iter().filter(|(wanted, _)| *wanted).map(|(_, at)| channel(extras.clone(), at, 1)));
    }
    Ok(if parts.len() > 1 { Cube::float_cat(parts, 3) } else { parts.swap_remove(0) })
}

/// Gradients with respect to images, `[images, height, width, channels]`: of one, strip by strip, or of a batch.
pub(super) fn image_gradients(
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
    let mut copies = Copies::new(renderer)?;
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
pub(super) fn gradient_tensors(
    renderer: &GpuRenderer,
    gradients: &GpuGradients,
    shapes: &[Shape; INPUTS],
    device: &CubeDevice,
) -> Result<Inputs<Cube>, SplatError> {
    // Without rendered scalars, their gradient is zero.
    let zeros = |shape: &Shape| Cube::float_zeros(shape.clone(), device, FloatDType::F32);
    let tensors: Inputs<Cube> = shapes.each_ref().map(zeros);
    let mut copies = Copies::new(renderer)?;
    let mut first = 0;
    for part in &gradients.parts {
        let count = part.count as usize;
        let stored = 3 * sh_coefficients(gradients.sh_degree);
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

#[expect(clippy::expect_used, reason = "an adapter has room for fewer")]
pub(super) fn in_u32(count: usize) -> u32 {
    u32::try_from(count).expect("fewer scenes and Gaussians than 32 bits can count")
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
