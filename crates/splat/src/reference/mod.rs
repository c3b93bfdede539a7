//! The reference renderer in f64 that every other backend is tested against: a plain loop over Gaussians and pixels,
//! and its exact gradient.

mod composite;
mod composite_backward;
mod jumps;
pub(crate) mod project;
pub(crate) mod project_backward;

pub(crate) use composite_backward::SplatGradient;
pub use jumps::{Jump, jumps};

use glam::DVec3;

use crate::{Gaussians, Gradients, ImageGradients, RenderOptions, Rendering, SplatError, View};

use project::Splat;

/// Limit on the bytes of the images.
const LIMIT: u64 = 16 << 30;

/// Renders a view.
///
/// # Errors
/// [`SplatError::View`], [`SplatError::Camera`], [`SplatError::Options`], [`SplatError::Constants`];
/// [`SplatError::Memory`] for images of more than 16 GiB.
pub fn render(gaussians: &Gaussians, view: &View, options: &RenderOptions) -> Result<Rendering<f64>, SplatError> {
    options.check()?;
    render_unchecked(gaussians, view, options)
}

/// As [`render()`] without checking the options: finite differences need a `min_alpha` below
/// [`crate::SMALLEST_MIN_ALPHA`], which f64 supports.
pub(crate) fn render_unchecked(
    gaussians: &Gaussians,
    view: &View,
    options: &RenderOptions,
) -> Result<Rendering<f64>, SplatError> {
    let (splats, mut rendering) = prepare(gaussians, view, options)?;
    for (pixel, at) in composite::pixels(view).enumerate() {
        composite::composite(&splats, at, options, pixel, &mut rendering);
    }
    options.expose(&mut rendering, |value| value);
    Ok(rendering)
}

/// A projected Gaussian.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Projection {
    /// Projected centre in pixels.
    pub centre: [f64; 2],
    /// Inverse 2D covariance, blur included: `(a, b, c)` of `½(a·dx² + c·dy²) + b·dx·dy`.
    pub conic: [f64; 3],
    /// Depth along the optical axis, in scene units.
    pub depth: f64,
    /// After the sigmoid, the 3D filter and anti-aliasing.
    pub opacity: f64,
    /// View-dependent colour, at least 0.
    pub rgb: [f64; 3],
}

/// Projects every Gaussian; `None` for those that are not drawn.
///
/// # Errors
/// As [`render`].
pub fn project(
    gaussians: &Gaussians,
    view: &View,
    options: &RenderOptions,
) -> Result<Vec<Option<Projection>>, SplatError> {
    options.check()?;
    project_unchecked(gaussians, view, options)
}

/// As [`project()`] without checking the options.
pub(crate) fn project_unchecked(
    gaussians: &Gaussians,
    view: &View,
    options: &RenderOptions,
) -> Result<Vec<Option<Projection>>, SplatError> {
    options.check_harmonics(gaussians)?;
    let optics = view.optics(&options.constants)?;
    let one = |position| {
        let splat = project::project(gaussians, position, &optics, view.size, options).ok()?;
        Some(Projection {
            centre: splat.centre.to_array(),
            conic: splat.conic.to_array(),
            depth: splat.depth,
            opacity: splat.opacity,
            rgb: splat.rgb.to_array(),
        })
    };
    Ok((0..gaussians.len()).map(one).collect())
}

/// Gradients of a loss with respect to every input, from its gradients with respect to the images.
///
/// # Errors
/// As [`render`], and [`SplatError::Length`] for an image whose size differs from the view's, [`SplatError::NonFinite`]
/// for gradients that are not finite.
pub fn backward(
    gaussians: &Gaussians,
    view: &View,
    options: &RenderOptions,
    images: &ImageGradients<f64>,
) -> Result<Gradients<f64>, SplatError> {
    options.check()?;
    backward_unchecked(gaussians, view, options, images)
}

/// As [`backward()`] without checking the options.
pub(crate) fn backward_unchecked(
    gaussians: &Gaussians,
    view: &View,
    options: &RenderOptions,
    images: &ImageGradients<f64>,
) -> Result<Gradients<f64>, SplatError> {
    images.check(view)?;
    let options = &*options.in_full();
    let images = options.before_exposure(images);
    let (splats, _) = prepare(gaussians, view, options)?;
    let mut gradients = Gradients::zero(gaussians);
    let mut d_splats = vec![SplatGradient::default(); splats.len()];
    for (pixel, at) in composite::pixels(view).enumerate() {
        let image = images.at(pixel);
        let background = composite_backward::composite_backward(&splats, at, options, &image, &mut d_splats);
        for (sum, value) in gradients.background.iter_mut().zip(background) {
            *sum += value;
        }
    }
    let optics = view.optics(&options.constants)?;
    for (splat, d_splat) in splats.iter().zip(&d_splats) {
        let d_gaussian = project_backward::gaussian_gradient(gaussians, &optics, options, splat, d_splat);
        gradients.store(splat.position, &d_gaussian, d_splat);
        for (sum, value) in gradients.pose.iter_mut().zip(d_gaussian.pose.iter().flat_map(DVec3::to_array)) {
            *sum += value;
        }
    }
    Ok(gradients)
}

/// The splats in compositing order (nearest first, ties by index), and an empty rendering.
fn prepare(
    gaussians: &Gaussians,
    view: &View,
    options: &RenderOptions,
) -> Result<(Vec<Splat>, Rendering<f64>), SplatError> {
    options.check_harmonics(gaussians)?;
    let optics = view.optics(&options.constants)?;
    let (images, limit) = (Rendering::<f64>::bytes(view, options), LIMIT);
    if images > limit {
        return Err(SplatError::Memory { needed: images, limit });
    }
    let mut rendering = Rendering::empty(view, options);
    let mut splats = Vec::new();
    for position in 0..gaussians.len() {
        match project::project(gaussians, position, &optics, view.size, options) {
            Ok(splat) => {
                rendering.counts.drawn += 1;
                splats.push(*splat);
            }
            Err(culled) => rendering.counts.count(culled),
        }
    }
    // Published rasterizers sort f32 keys, so depths that are equal in f32 keep their order.
    #[expect(clippy::cast_possible_truncation, reason = "see above")]
    splats.sort_by(|a, b| (a.depth as f32).total_cmp(&(b.depth as f32)).then(a.position.cmp(&b.position)));
    Ok((splats, rendering))
}

#[cfg(test)]
mod tests;
