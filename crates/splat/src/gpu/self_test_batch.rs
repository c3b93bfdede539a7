//! The batch of the self-test: the kernels that look up each splat's view, against those of single views.

use std::ops::Range;

use atsplat_camera::ImageSize;

use super::kernels::Pool;
use super::self_test::{
    GRADIENT_BOUND, PIXEL_BOUND, check, gaussians, image_gradients, images_of, max_difference, miscounted, options,
    relative_difference, view,
};
use super::{GpuError, GpuImageGradients, GpuRenderer};
use crate::renderer::saturated;
use crate::{
    GaussianCounts, Gaussians, GradientField, Gradients, ImageGradients, RenderOptions, Renderer as _, SplatError, View,
};

/// Not as many as views of a scene, so that one cannot stand for the other.
const SCENES: u32 = 2;
const VIEWS_OF_SCENE: u32 = 3;
/// Gaussians of a scene; workgroups of 64 cross from one image to the next. Bindings of 64 KiB hold the batch.
const COUNT: u16 = 50;
/// Of each image: its tiles are not full.
const SIZE: ImageSize = ImageSize { width: 19, height: 17 };

/// Small scenes, and views of each from different places.
pub(super) struct Batch {
    scenes: [Gaussians; SCENES as usize],
    /// The Gaussians of all scenes.
    joined: Gaussians,
    views: Vec<View>,
    options: RenderOptions,
    /// Of the images below each other.
    images: ImageGradients<f32>,
}

impl Batch {
    pub(super) fn new() -> Result<Self, SplatError> {
        let views = (0..SCENES * VIEWS_OF_SCENE).map(|at| view(at.into(), SIZE));
        let views = views.collect::<Result<Vec<_>, _>>()?;
        Ok(Self {
            scenes: [gaussians(0..COUNT)?, gaussians(COUNT..2 * COUNT)?],
            joined: gaussians(0..2 * COUNT)?,
            images: image_gradients(views.iter().map(View::pixels).sum()).map(saturated),
            views,
            options: options(),
        })
    }

    /// Each view with its scene.
    fn one_by_one(&self) -> impl Iterator<Item = (&Gaussians, &View)> {
        let views = self.views.chunks(VIEWS_OF_SCENE as usize);
        self.scenes.iter().zip(views).flat_map(|(scene, views)| views.iter().map(move |view| (scene, view)))
    }

    /// Compares counts and images with those of the views one by one.
    pub(super) fn check_images(&self, renderer: &mut GpuRenderer) -> Result<(), SplatError> {
        let resident = renderer.upload(&self.joined)?;
        let pending = renderer.render_batch(&resident, SCENES, &self.views, &self.options)?;
        let actual = renderer.read(&pending)?.map(f64::from);
        let (mut counts, mut images) = (GaussianCounts::default(), Vec::new());
        for (scene, view) in self.one_by_one() {
            let rendering = renderer.render(scene, view, &self.options)?.map(f64::from);
            counts += rendering.counts;
            images.push(images_of(rendering));
        }
        let adapter = renderer.adapter();
        check(adapter, "Gaussian count of a batch", miscounted(actual.counts, counts), 0.0)?;
        for (at, (what, actual)) in images_of(actual).iter().enumerate() {
            let expected: Vec<f64> = images.iter().flat_map(|images| images[at].1.iter().copied()).collect();
            check(adapter, &format!("{what} of a batch"), max_difference(actual, &expected), PIXEL_BOUND)?;
        }
        Ok(())
    }

    /// Compares gradients with those of the views one by one.
    pub(super) fn check_gradients(&self, renderer: &mut GpuRenderer) -> Result<(), SplatError> {
        let resident = renderer.upload(&self.joined)?;
        let by_images = self.upload_images(renderer)?;
        let pending = renderer.backward_batch(&resident, SCENES, &self.views, &self.options, &by_images)?;
        let actual = renderer.read_gradients(&pending, &self.joined)?.map(f64::from);
        let mut alone = Vec::new();
        for (at, (scene, view)) in self.one_by_one().enumerate() {
            let images = part(&self.images, at * view.pixels()..(at + 1) * view.pixels());
            alone.push(renderer.backward(scene, view, &self.options, &images)?.map(f64::from));
        }
        let adapter = renderer.adapter();
        for ((field, actual), expected) in actual.fields().into_iter().zip(joined(&alone)) {
            let what = format!("gradient of {field} of a batch");
            check(adapter, &what, relative_difference(actual, &expected), GRADIENT_BOUND)?;
        }
        Ok(())
    }

    fn upload_images(&self, renderer: &GpuRenderer) -> Result<GpuImageGradients, GpuError> {
        let rows = SCENES * VIEWS_OF_SCENE * SIZE.height;
        let stacked = View { size: ImageSize { height: rows, ..SIZE }, ..self.views[0] };
        let (context, strips) = (&renderer.context, [[0, rows]]);
        context.guarded(|| GpuImageGradients::upload(context, &mut Pool::default(), &stacked, &strips, &self.images))
    }
}

/// Gradients of some pixels.
fn part(images: &ImageGradients<f32>, pixels: Range<usize>) -> ImageGradients<f32> {
    let cut = |image: &Option<Vec<f32>>| image.as_ref().map(|image| image[pixels.clone()].to_vec());
    ImageGradients {
        rgb: images.rgb[pixels.clone()].to_vec(),
        alpha: cut(&images.alpha),
        depth: cut(&images.depth),
        scalar: cut(&images.scalar),
    }
}

/// The gradients of a batch by field, from those of its views: scene after scene, each summed over its views; those of the
/// pose and the background are summed over all.
fn joined(views: &[Gradients<f64>]) -> Vec<Vec<f64>> {
    let fields: Vec<_> = views.iter().map(Gradients::fields).collect();
    let known = fields.first().into_iter().flatten().map(|(field, _)| *field);
    let of_field = |(at, field): (usize, GradientField)| {
        let each = if field.is_of_gaussians() { VIEWS_OF_SCENE as usize } else { fields.len() };
        fields.chunks(each).flat_map(|views| sum(views.iter().map(|fields| fields[at].1))).collect::<Vec<f64>>()
    };
    known.enumerate().map(of_field).collect()
}

fn sum<'a>(lists: impl Iterator<Item = &'a [f64]>) -> Vec<f64> {
    let mut sums: Vec<f64> = Vec::new();
    for list in lists {
        sums.resize(list.len(), 0.0);
        for (sum, value) in sums.iter_mut().zip(list) {
            *sum += *value;
        }
    }
    sums
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn gradients_are_summed_over_the_views_of_their_scene_and_of_pose_and_background_over_all() {
        let view = |value: f64| Gradients {
            opacity_logits: vec![value, 10.0 * value],
            means_2d: vec![[value, -value]],
            pose: [0.0, 0.0, 0.0, 0.0, 0.0, value],
            ..Gradients::default()
        };
        let views = [1.0, 2.0, 4.0, 8.0, 16.0, 32.0].map(view);
        let found = joined(&views);
        assert_eq!(found.len(), views[0].fields().len());
        let of = |name: &str| &found[views[0].fields().iter().position(|(field, _)| field.name() == name).unwrap()][..];
        assert_eq!(of("opacity_logits"), [7.0, 70.0, 56.0, 560.0]);
        assert_eq!(of("means_2d"), [7.0, -7.0, 56.0, -56.0]);
        assert_eq!(of("pose"), [0.0, 0.0, 0.0, 0.0, 0.0, 63.0]);
        assert_eq!(of("background"), [0.0; 3]);
        assert_eq!(of("sh"), [0.0; 0]);
    }
}
