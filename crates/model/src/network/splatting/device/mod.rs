//! Rendering on burn's GPU: tensors are copied within its memory, and only counts are copied to the host.

mod backward;
mod forward;
mod shared;
mod tensors;

use std::sync::Arc;

use atsplat_splat::gpu::GpuGaussians;
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
        let gradients = scenes.zip(renderer_of(&images)).and_then(|(scenes, mut renderer)| {
            let gradients = backward::gradients(&mut renderer, &scenes, &images, shapes, request);
            gradients.inspect_err(|error| tracing::error!(%error, "no gradients of a rendering")).ok()
        });
        let unknown = |shape: &Shape| Self::float_full(shape.clone(), f32::NAN.into(), &device, FloatDType::F32);
        gradients.unwrap_or_else(|| shapes.each_ref().map(unknown))
    }
}
