//! Rendering on burn's GPU: tensors are copied within its memory, and only counts are copied to the host.

mod backward;
mod forward;
mod shared;
mod tensors;

use std::sync::Arc;

use atsplat_splat::SplatError;
use atsplat_splat::gpu::{GpuError, GpuGaussians, GpuRenderer};
use burn::backend::ops::FloatTensorOps as _;
use burn::backend::tensor::FloatTensor;
use burn::backend::{Cube, TensorMetadata as _};
use burn::tensor::{FloatDType, Shape};

use super::{INPUTS, Inputs, RenderBackend, Request, host};
use shared::renderer_of;

pub(in crate::network) use shared::{counts, is_shared, render_error, share};

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

/// Makes room to do scenes one by one after an error of all at once; returns errors that this does not avoid.
fn make_room(renderer: &mut GpuRenderer, error: SplatError) -> Result<(), SplatError> {
    if !is_too_large(&error) {
        return Err(error);
    }
    tracing::debug!(%error, "doing the scenes of a batch one by one");
    if matches!(error, SplatError::Gpu(GpuError::OutOfMemory { .. })) {
        renderer.free_buffers();
    }
    Ok(())
}

/// Whether less work at once avoids the error: a launch, the limit on memory or the adapter's memory was too small.
const fn is_too_large(error: &SplatError) -> bool {
    matches!(
        error,
        SplatError::Memory { .. } | SplatError::Gpu(GpuError::TooLarge { .. } | GpuError::OutOfMemory { .. })
    )
}

impl RenderBackend for Cube {
    type Recorded = Recorded;

    fn render(inputs: Inputs<Self>, request: &Request) -> FloatTensor<Self> {
        Self::record(inputs, request).1
    }

    fn record(inputs: Inputs<Self>, request: &Request) -> (Recorded, FloatTensor<Self>) {
        let device = inputs[0].device();
        let Some(mut renderer) = renderer_of(&inputs[0]) else {
            let (recorded, images) = host::record::<Self>(inputs, request);
            return (Recorded::Host(recorded), images);
        };
        match forward::rendered(&mut renderer, &inputs, request) {
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
        let gradients = match scenes.zip(renderer_of(&images)) {
            Some((scenes, mut renderer)) => {
                backward::gradients(&mut renderer, &scenes, &images, shapes, request).map_err(|error| error.to_string())
            }
            None => Err("the images were not rendered on their device".to_owned()),
        };
        let unknown = |shape: &Shape| Self::float_full(shape.clone(), f32::NAN.into(), &device, FloatDType::F32);
        gradients.unwrap_or_else(|reason| {
            tracing::error!(%reason, "no gradients of a rendering");
            request.set_backward_failure(reason);
            shapes.each_ref().map(unknown)
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_batch_without_room_is_done_scene_by_scene() {
        let adapter = || "a card".to_owned();
        let reason = || "none left".to_owned();
        let too_large =
            GpuError::TooLarge { adapter: adapter(), what: "views", unit: "views", needed: 162, limit: 160 };
        let errors: [(SplatError, bool); 6] = [
            (GpuError::OutOfMemory { adapter: adapter(), reason: reason() }.into(), true),
            (too_large.into(), true),
            (SplatError::Memory { needed: 9, limit: 8 }, true),
            (GpuError::Rejected { adapter: adapter(), reason: reason() }.into(), false),
            (GpuError::Device { adapter: adapter(), reason: reason() }.into(), false),
            (SplatError::Length { field: "views", expected: 1, found: 0 }, false),
        ];
        for (error, expected) in errors {
            assert_eq!(is_too_large(&error), expected, "{error}");
        }
    }
}
