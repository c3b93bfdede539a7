use std::sync::Arc;

use atsplat_splat::{Census, RenderOptions, View};
use burn::Tensor;
use burn::backend::Dispatch;

use super::GaussianTensors;
#[cfg(doc)]
use super::Processor;
use super::splatting::{Request, Splatting};
use crate::ModelError;

/// Images through which gradients flow to the Gaussians; `height` and `width` are the views'.
#[derive(Clone, Debug)]
pub struct RenderedTensors {
    /// Colour over the background, not clamped, `[views, height, width, 3]`.
    pub rgb: Tensor<4>,
    /// Opacity, `[views, height, width]`.
    pub alpha: Tensor<3>,
    /// Depth along the optical axis, composited like a colour on 0, `[views, height, width]`; where asked for.
    pub depth: Option<Tensor<3>>,
    /// The Gaussians' own scalar, composited like a colour on 0, `[views, height, width]`; where asked for.
    pub scalar: Option<Tensor<3>>,
    /// What became of the Gaussians, view by view.
    pub census: Vec<Census>,
}

impl GaussianTensors {
    /// Renders one scene of the batch to views of one size, where the tensors are: see [`Processor::renders`].
    ///
    /// `scalars`, `[Gaussians]`, are what the channel `scalar` composites, e.g. the uncertainty of the tokens;
    /// [`atsplat_splat::GradientReach`] says how far its gradient reaches. Where the derivative of a rendering fails for
    /// want of memory, gradients are NaN.
    ///
    /// # Errors
    /// [`ModelError::Splat`] as the splatter says; [`ModelError::Malformed`] where there is no such scene or no view, views
    /// differ in size, or scalars do not come with their channel.
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
        let mut image = |wanted: bool| {
            wanted.then(|| {
                next += 1;
                images.clone().slice_dim(3, next - 1..next).reshape([count, height, width])
            })
        };
        let (alpha, depth, scalar) = (image(true), image(options.channels.depth), image(options.channels.scalar));
        let rgb = images.clone().slice_dim(3, 0..3);
        let alpha = alpha.unwrap_or_else(|| rgb.clone().slice_dim(3, 0..1).squeeze_dim(3));
        Ok(RenderedTensors { rgb, alpha, depth, scalar, census })
    }
}
