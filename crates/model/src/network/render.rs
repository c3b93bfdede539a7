use std::sync::Arc;

use atsplat_splat::{Census, RenderOptions, View};
use burn::Tensor;
use burn::backend::Dispatch;

use super::GaussianTensors;
#[cfg(doc)]
use super::Processor;
use super::splatting::{Request, Splatting};
use crate::ModelError;

/// Rendered images with gradients to the Gaussians; `height` and `width` are the views'.
#[derive(Clone, Debug)]
pub struct RenderedTensors {
    /// Colour over the background, not clamped, `[views, height, width, 3]`.
    pub rgb: Tensor<4>,
    /// Opacity, `[views, height, width]`.
    pub alpha: Tensor<3>,
    /// Depth along the optical axis, composited like a colour on 0, `[views, height, width]`; if requested.
    pub depth: Option<Tensor<3>>,
    /// The Gaussians' own scalar, composited like a colour on 0, `[views, height, width]`; if requested.
    pub scalar: Option<Tensor<3>>,
    /// Counts of drawn and skipped Gaussians, by view.
    pub census: Vec<Census>,
}

impl GaussianTensors {
    /// Renders one scene of the batch to views of one size, on the tensors' device: see [`Processor::renders`].
    ///
    /// `scalars`, `[Gaussians]`, are composited in the channel `scalar`, e.g. the uncertainty of the tokens;
    /// [`atsplat_splat::GradientReach`] says how far its gradient reaches. If the backward pass of a rendering runs out of
    /// memory, gradients are NaN.
    ///
    /// # Errors
    /// [`ModelError::Splat`] for errors of the renderer; [`ModelError::Malformed`] if there is no such scene or no view,
    /// views differ in size, or scalars are given without their channel or the reverse.
    pub fn render(
        &self,
        scene: usize,
        views: &[View],
        options: &RenderOptions,
        scalars: Option<Tensor<1>>,
    ) -> Result<RenderedTensors, ModelError> {
        let [scenes, count, _] = self.means.dims();
        if scene >= scenes {
            return Err(ModelError::malformed("rendering", "scene", format!("one of {scenes}"), scene));
        }
        let size = match views {
            [first, rest @ ..] if rest.iter().all(|view| view.size == first.size) => first.size,
            _ => return Err(ModelError::malformed("rendering", "views", "one or more of one size", views.len())),
        };
        let given = scalars.as_ref().map(Tensor::dims);
        if given != options.channels.scalar.then_some([count]) {
            let expected = "one for each Gaussian, with the channel `scalar`";
            return Err(ModelError::malformed("rendering", "scalars", expected, format!("{given:?}")));
        }
        let rows = |x: &Tensor<3>| x.clone().slice_dim(0, scene..scene + 1).into_dispatch();
        let scalars = scalars.unwrap_or_else(|| Tensor::zeros([count], &self.means.device()));
        let request = Arc::new(Request::new(views.to_vec(), options.clone(), self.sh_degree));
        let images = Dispatch::splat(
            rows(&self.means),
            rows(&self.quaternions),
            rows(&self.log_scales),
            rows(&self.opacity_logits.clone().unsqueeze_dim(2)),
            rows(&self.sh),
            scalars.into_dispatch(),
            Arc::clone(&request),
        );
        let census = request.outcome()?;

        let images = Tensor::<4>::from_dispatch(images);
        let [count, height, width] = [views.len(), size.height as usize, size.width as usize];
        let mut next = 3;
        let mut image = || {
            next += 1;
            images.clone().slice_dim(3, next - 1..next).reshape([count, height, width])
        };
        let alpha = image();
        let depth = options.channels.depth.then(&mut image);
        let scalar = options.channels.scalar.then(image);
        Ok(RenderedTensors { rgb: images.slice_dim(3, 0..3), alpha, depth, scalar, census })
    }
}
