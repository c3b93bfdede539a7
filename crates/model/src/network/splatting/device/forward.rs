use atsplat_splat::gpu::GpuRenderer;
use atsplat_splat::{GaussianCounts, SplatError};
use burn::backend::ops::FloatTensorOps as _;
use burn::backend::tensor::FloatTensor;
use burn::backend::{Cube, TensorMetadata as _};
use burn::tensor::Slice;

use super::super::{Inputs, Request};
use super::tensors::{gaussians_of, image_tensor, in_u32};
use super::{Scenes, make_room};

/// Renders every view; the Gaussians' buffers are kept for the backward pass.
pub(super) fn rendered(
    renderer: &mut GpuRenderer,
    inputs: &Inputs<Cube>,
    request: &Request,
) -> Result<(Vec<Scenes>, FloatTensor<Cube>), SplatError> {
    let splats = inputs[0].shape().num_elements() / 3 / request.scenes.max(1) * request.views.len();
    let at_once = match request.scenes {
        // What is too large for one launch is rendered scene by scene. The backward pass needs room for a few tiles of each splat.
        scenes if scenes == 1 || 2 * splats > renderer.part_length(request.sh_degree) => None,
        scenes => match batch(renderer, inputs, scenes, request) {
            Ok(rendered) => Some(rendered),
            Err(error) => {
                make_room(renderer, error)?;
                None
            }
        },
    };
    let (scenes, counts, images) = match at_once {
        Some(rendered) => rendered,
        None => scene_by_scene(renderer, inputs, request)?,
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
    let gaussians = gaussians_of(renderer, inputs, request)?;
    let pending = renderer.render_batch(&gaussians, in_u32(scenes), &request.views, &request.options)?;
    let settled = renderer.settle(&pending)?;
    let images = image_tensor(renderer, settled.result, request.views.len(), request, &inputs[0])?;
    Ok((vec![Scenes { gaussians, count: scenes }], vec![settled.counts], images))
}

/// Each view by separate launches, with one wait for a scene.
fn scene_by_scene(
    renderer: &mut GpuRenderer,
    inputs: &Inputs<Cube>,
    request: &Request,
) -> Result<Rendered, SplatError> {
    let (mut scenes, mut counts, mut images) = (Vec::new(), Vec::new(), Vec::new());
    for (scene, views) in request.views_by_scene().enumerate() {
        let row = |input: &FloatTensor<Cube>| Cube::float_slice(input.clone(), &[Slice::from(scene..scene + 1)]);
        let gaussians = match request.scenes {
            1 => gaussians_of(renderer, inputs, request)?,
            _ => gaussians_of(renderer, &inputs.each_ref().map(row), request)?,
        };
        let mut render = |view| renderer.render_resident(&gaussians, view, &request.options);
        let pending = views.iter().map(&mut render).collect::<Result<Vec<_>, _>>()?;
        for settled in renderer.settle_all(&pending.iter().collect::<Vec<_>>())? {
            counts.push(settled.counts);
            images.push(image_tensor(renderer, settled.result, 1, request, &inputs[0])?);
        }
        scenes.push(Scenes { gaussians, count: 1 });
    }
    Ok((scenes, counts, Cube::float_cat(images, 0)))
}
