use atsplat_splat::gpu::{GpuGaussians, GpuPart, GpuRenderer};
use atsplat_splat::{SplatError, sh_coefficients};
use burn::backend::ops::FloatTensorOps as _;
use burn::backend::tensor::FloatTensor;
use burn::backend::{Cube, CubeDevice, TensorMetadata as _};
use burn::tensor::{FloatDType, Shape, Slice};

use super::super::copies::Copies;
use super::super::{INPUTS, Inputs, Request};
use super::tensors::{gradient_tensors, image_gradients, in_u32};
use super::{Scenes, make_room};

/// Gradients with respect to the inputs, summed over the views of each scene in their order.
pub(super) fn gradients(
    renderer: &mut GpuRenderer,
    scenes: &[Scenes],
    images: &FloatTensor<Cube>,
    shapes: &[Shape; INPUTS],
    request: &Request,
) -> Result<Inputs<Cube>, SplatError> {
    let (gaussians, count) = match scenes {
        [Scenes { gaussians, count }] if *count > 1 => (gaussians, *count),
        _ => return gradients_scene_by_scene(renderer, scenes, images, shapes, request),
    };
    // A pair of the backward pass takes six times the memory of a pair of the forward pass, which fitted.
    match gradients_at_once(renderer, (gaussians, count), images, shapes, request) {
        Ok(gradients) => Ok(gradients),
        Err(error) => {
            make_room(renderer, error)?;
            let scenes = separated(renderer, gaussians, count, images)?;
            gradients_scene_by_scene(renderer, &scenes, images, shapes, request)
        }
    }
}

/// All scenes of a batch by one launch of each kernel.
fn gradients_at_once(
    renderer: &mut GpuRenderer,
    (gaussians, count): (&GpuGaussians, usize),
    images: &FloatTensor<Cube>,
    shapes: &[Shape; INPUTS],
    request: &Request,
) -> Result<Inputs<Cube>, SplatError> {
    let by_images = image_gradients(renderer, images, request)?;
    let pending = renderer.backward_batch(gaussians, in_u32(count), &request.views, &request.options, &by_images)?;
    let settled = renderer.settle(&pending)?;
    gradient_tensors(renderer, settled.result, shapes, &images.device())
}

/// The scenes of a batch, each in separate buffers, on the device of a tensor.
fn separated(
    renderer: &GpuRenderer,
    batch: &GpuGaussians,
    count: usize,
    device_of: &FloatTensor<Cube>,
) -> Result<Vec<Scenes>, SplatError> {
    let stored = 3 * sh_coefficients(batch.sh_degree());
    let mut copies = Copies::new(renderer)?;
    let mut scenes = Vec::with_capacity(count);
    for scene in 0..count {
        let of_scene = |part: &GpuPart| -> Result<GpuPart, SplatError> {
            let gaussians = part.count as usize / count;
            let mut rows = |buffer, each: usize| copies.of_buffer(buffer, scene * gaussians * each, gaussians * each);
            Ok(GpuPart {
                count: in_u32(gaussians),
                means: rows(&part.means, 3)?,
                quaternions: rows(&part.quaternions, 4)?,
                log_scales: rows(&part.log_scales, 3)?,
                opacity_logits: rows(&part.opacity_logits, 1)?,
                sh: rows(&part.sh, stored)?,
                scalars: part.scalars.as_ref().map(|scalars| rows(scalars, 1)).transpose()?,
                filter_3d: None,
            })
        };
        let parts = batch.parts().iter().map(of_scene).collect::<Result<Vec<_>, _>>()?;
        scenes.push(Scenes { gaussians: GpuGaussians::from_parts(parts, batch.sh_degree())?, count: 1 });
    }
    copies.submit(device_of)?;
    Ok(scenes)
}

fn gradients_scene_by_scene(
    renderer: &mut GpuRenderer,
    scenes: &[Scenes],
    images: &FloatTensor<Cube>,
    shapes: &[Shape; INPUTS],
    request: &Request,
) -> Result<Inputs<Cube>, SplatError> {
    let device = images.device();
    let of_one_scene = |shape: &Shape| std::iter::once(1).chain(shape.iter().skip(1).copied()).collect::<Shape>();
    let scene_shapes = shapes.each_ref().map(of_one_scene);
    let mut views = request.views.iter().enumerate();
    let mut by_scene: Vec<Inputs<Cube>> = Vec::new();
    for (Scenes { gaussians, .. }, of_scene) in scenes.iter().zip(request.views_by_scene()) {
        let mut pending = Vec::new();
        for (at, view) in views.by_ref().take(of_scene.len()) {
            let image = Cube::float_slice(images.clone(), &[Slice::from(at..at + 1)]);
            let by_images = image_gradients(renderer, &image, request)?;
            pending.push(renderer.backward_resident(gaussians, view, &request.options, &by_images)?);
        }
        let settled = renderer.settle_all(&pending.iter().collect::<Vec<_>>())?;
        let by_view = settled.iter().map(|view| gradient_tensors(renderer, view.result, &scene_shapes, &device));
        by_scene.push(summed(by_view.collect::<Result<_, _>>()?, &scene_shapes, &device));
    }
    Ok(if by_scene.len() == 1 { by_scene.swap_remove(0) } else { joined(&by_scene) })
}

fn summed(by_view: Vec<Inputs<Cube>>, shapes: &[Shape; INPUTS], device: &CubeDevice) -> Inputs<Cube> {
    let sum = by_view.into_iter().reduce(|sums, view| {
        let mut gradients = view.into_iter();
        sums.map(|sum| match gradients.next() {
            Some(gradient) => Cube::float_add(sum, gradient),
            None => sum,
        })
    });
    sum.unwrap_or_else(|| shapes.each_ref().map(|shape| Cube::float_zeros(shape.clone(), device, FloatDType::F32)))
}

/// Scenes one after the other.
fn joined(scenes: &[Inputs<Cube>]) -> Inputs<Cube> {
    std::array::from_fn(|input| Cube::float_cat(scenes.iter().map(|scene| scene[input].clone()).collect(), 0))
}
