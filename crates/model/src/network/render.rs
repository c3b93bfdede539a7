use std::ops::Range;
use std::sync::Arc;

use atsplat_splat::{GaussianCounts, RenderOptions, View};
use burn::Tensor;
use burn::backend::Dispatch;
use burn::tensor::TensorData;

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
    /// The Gaussians' scalar, composited like a colour on 0, `[views, height, width]`; if requested.
    pub scalar: Option<Tensor<3>>,
    /// Counts of drawn and skipped Gaussians: by view, or of all views together if they were rendered at once.
    pub counts: Vec<GaussianCounts>,
    /// Says whether the backward pass failed.
    pub backward: BackwardPass,
    /// All channels as they were rendered, `[views, height, width, channels]`.
    images: Tensor<4>,
}

impl RenderedTensors {
    /// A number with given derivatives with respect to the images, for losses that are not computed with tensors: with respect to
    /// colour, three for each pixel, and to the scalar, one for each pixel, each view by view and row by row, and with a factor. They
    /// are 0 where none are given.
    ///
    /// # Panics
    /// If derivatives with respect to the scalar are given, but it was not requested.
    pub fn with_derivatives(&self, rgb: Option<(&[f32], f32)>, scalar: Option<(&[f32], f32)>) -> Tensor<1> {
        let shape = self.images.dims();
        let [_, _, _, channels] = shape;
        let mut derivatives = vec![0.0; shape.iter().product()];
        if let Some((rgb, weight)) = rgb {
            for (pixel, rgb) in derivatives.chunks_exact_mut(channels).zip(rgb.as_chunks::<3>().0) {
                pixel.iter_mut().zip(rgb).for_each(|(slot, value)| *slot = value * weight);
            }
        }
        if let Some((scalar, weight)) = scalar {
            assert!(self.scalar.is_some(), "derivatives of the rendered scalar");
            for (pixel, value) in derivatives.chunks_exact_mut(channels).zip(scalar) {
                // The last channel.
                pixel[channels - 1] = value * weight;
            }
        }
        let derivatives = Tensor::<4>::from_data(TensorData::new(derivatives, shape), &self.images.device());
        (self.images.clone() * derivatives).sum()
    }
}

/// The backward pass of a rendering; the graph that it is part of can show a failure only as NaN.
#[derive(Clone, Debug)]
pub struct BackwardPass(Arc<Request>);

impl BackwardPass {
    /// Why it failed; `None` if it did not, or has not run.
    pub fn failure(&self) -> Option<String> {
        self.0.backward_failure()
    }
}

impl GaussianTensors {
    /// Renders one scene of the batch to views of one size, on the tensors' device: see [`Processor::renders`].
    ///
    /// `scalars`, `[Gaussians]`, are composited in the channel `scalar`, e.g. the uncertainty of the tokens;
    /// [`atsplat_splat::StoppedGradients`] says how far its gradient reaches. If the backward pass of a rendering fails, as
    /// without enough memory, gradients are NaN, and [`BackwardPass::failure`] says why.
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
        let [scenes, ..] = self.means.dims();
        if scene >= scenes {
            return Err(ModelError::malformed("rendering", "scene", format!("one of {scenes}"), scene));
        }
        let scalars = scalars.map(|scalars| scalars.unsqueeze_dim(0));
        self.scenes(scene..scene + 1).render_all(&[views.to_vec()], options, scalars)
    }

    /// Renders every scene to the same number of views, all of one size, as [`Self::render`] does; images of the first scene come first.
    /// On a graphics adapter, every kernel runs once for all of them if they fit its memory. `scalars` are `[scenes, Gaussians]`.
    ///
    /// # Errors
    /// As [`Self::render`].
    pub fn render_all(
        &self,
        views: &[Vec<View>],
        options: &RenderOptions,
        scalars: Option<Tensor<2>>,
    ) -> Result<RenderedTensors, ModelError> {
        let [scenes, count, _] = self.means.dims();
        let of_scene = views.first().map_or(0, Vec::len);
        if views.len() != scenes || views.iter().any(|scene| scene.len() != of_scene) {
            let found = views.iter().map(|scene| scene.len().to_string()).collect::<Vec<_>>().join(", ");
            let expected = format!("the same number for each of {scenes} scenes");
            return Err(ModelError::malformed("rendering", "views", expected, found));
        }
        let views = views.concat();
        let size = match &views[..] {
            [first, rest @ ..] if rest.iter().all(|view| view.size == first.size) => first.size,
            _ => return Err(ModelError::malformed("rendering", "views", "one or more of one size", views.len())),
        };
        let given = scalars.as_ref().map(Tensor::dims);
        if given != options.channels.scalar.then_some([scenes, count]) {
            let expected = "one for each Gaussian, with the channel `scalar`";
            return Err(ModelError::malformed("rendering", "scalars", expected, format!("{given:?}")));
        }
        let scalars = scalars.unwrap_or_else(|| Tensor::zeros([scenes, count], &self.means.device()));
        let image_count = views.len();
        let request = Arc::new(Request::new(views, scenes, options.clone(), self.sh_degree));
        let images = Dispatch::splat(
            self.means.clone().into_dispatch(),
            self.quaternions.clone().into_dispatch(),
            self.log_scales.clone().into_dispatch(),
            self.opacity_logits.clone().unsqueeze_dim::<3>(2).into_dispatch(),
            self.sh.clone().into_dispatch(),
            scalars.into_dispatch(),
            Arc::clone(&request),
        );
        let counts = request.outcome()?;

        let images = Tensor::<4>::from_dispatch(images);
        let [height, width] = [size.height as usize, size.width as usize];
        let mut next = 3;
        let mut image = || {
            next += 1;
            images.clone().slice_dim(3, next - 1..next).reshape([image_count, height, width])
        };
        let alpha = image();
        let depth = options.channels.depth.then(&mut image);
        let scalar = options.channels.scalar.then(image);
        let backward = BackwardPass(request);
        let rgb = images.clone().slice_dim(3, 0..3);
        Ok(RenderedTensors { rgb, alpha, depth, scalar, counts, backward, images })
    }

    /// Some scenes of the batch.
    #[must_use]
    pub fn scenes(&self, scenes: Range<usize>) -> Self {
        let [all, ..] = self.means.dims();
        if scenes == (0..all) {
            // A slice of everything would copy every gradient.
            return self.clone();
        }
        let rows = |x: &Tensor<3>| x.clone().slice_dim(0, scenes.clone());
        Self {
            means: rows(&self.means),
            quaternions: rows(&self.quaternions),
            log_scales: rows(&self.log_scales),
            opacity_logits: self.opacity_logits.clone().slice_dim(0, scenes.clone()),
            sh: rows(&self.sh),
            sh_degree: self.sh_degree,
        }
    }
}
