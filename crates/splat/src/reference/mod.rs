//! The slow, obvious renderer in f64 that every other path is compared with: one Gaussian after the other, one
//! pixel after the other, and the derivative of exactly that.

mod backward;
mod band;
mod composite;
pub(crate) mod project;
pub(crate) mod project_backward;

pub(crate) use backward::SplatGradient;
pub use band::{Jump, jumps};

use glam::DVec3;

use crate::{Gaussians, Gradients, ImageGradients, RenderOptions, Rendering, SplatError, View};

use project::{Outcome, Splat};

/// Bytes that images may take.
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

/// As [`render()`], whatever the options: f64 fades below [`crate::SMALLEST_MIN_ALPHA`], where differences need it.
pub(crate) fn render_unchecked(
    gaussians: &Gaussians,
    view: &View,
    options: &RenderOptions,
) -> Result<Rendering<f64>, SplatError> {
    let (splats, mut rendering) = prepare(gaussians, view, options)?;
    for (pixel, at) in composite::pixel_centres(view).enumerate() {
        composite::composite(&splats, at, options, pixel, &mut rendering);
    }
    options.expose(&mut rendering, |value| value);
    Ok(rendering)
}

/// One Gaussian as the picture sees it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Projection {
    /// Projected centre in pixels.
    pub centre: [f64; 2],
    /// Inverse covariance on the screen, blur included: `(a, b, c)` of `½(a·dx² + c·dy²) + b·dx·dy`.
    pub conic: [f64; 3],
    /// Along the optical axis, in scene units.
    pub depth: f64,
    /// After the sigmoid, the 3D filter and anti-aliasing.
    pub opacity: f64,
    /// Colour from this side, at least 0.
    pub rgb: [f64; 3],
}

/// Where and how each Gaussian appears; `None` for those that are not drawn.
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

/// As [`project()`], whatever the options.
pub(crate) fn project_unchecked(
    gaussians: &Gaussians,
    view: &View,
    options: &RenderOptions,
) -> Result<Vec<Option<Projection>>, SplatError> {
    let optics = view.optics(&options.constants)?;
    let one = |position| match project::project(gaussians, position, &optics, view.size, options) {
        Outcome::Drawn(splat) => Some(Projection {
            centre: splat.centre.to_array(),
            conic: splat.conic.to_array(),
            depth: splat.depth,
            opacity: splat.opacity,
            rgb: splat.rgb.to_array(),
        }),
        _ => None,
    };
    Ok((0..gaussians.len()).map(one).collect())
}

/// Derivatives of a loss by everything that made the images, from its derivatives by the images.
///
/// # Errors
/// As [`render`], and [`SplatError::Length`] for an image of another size than the view's, [`SplatError::NonFinite`] for
/// derivatives that are not finite.
pub fn backward(
    gaussians: &Gaussians,
    view: &View,
    options: &RenderOptions,
    images: &ImageGradients<f64>,
) -> Result<Gradients<f64>, SplatError> {
    options.check()?;
    backward_unchecked(gaussians, view, options, images)
}

/// As [`backward()`], whatever the options.
pub(crate) fn backward_unchecked(
    gaussians: &Gaussians,
    view: &View,
    options: &RenderOptions,
    images: &ImageGradients<f64>,
) -> Result<Gradients<f64>, SplatError> {
    images.check(view)?;
    let images = options.before_exposure(images);
    let (splats, _) = prepare(gaussians, view, options)?;
    let mut gradients = Gradients::zero(gaussians);
    let mut of_splats = vec![SplatGradient::default(); splats.len()];
    for (pixel, at) in composite::pixel_centres(view).enumerate() {
        let image = images.at(pixel);
        let background = backward::composite(&splats, at, options, &image, &mut of_splats);
        for (sum, value) in gradients.background.iter_mut().zip(background) {
            *sum += value;
        }
    }
    let optics = view.optics(&options.constants)?;
    for (splat, of_splat) in splats.iter().zip(&of_splats) {
        let of_gaussian = project_backward::of_gaussian(gaussians, &optics, options, splat, of_splat);
        gradients.store(splat.position, &of_gaussian, of_splat, |value| value);
        for (sum, value) in gradients.pose.iter_mut().zip(of_gaussian.pose.iter().flat_map(DVec3::to_array)) {
            *sum += value;
        }
    }
    Ok(gradients)
}

/// Splats in the order they are composited, nearest first and ties by position, and an empty picture.
fn prepare(
    gaussians: &Gaussians,
    view: &View,
    options: &RenderOptions,
) -> Result<(Vec<Splat>, Rendering<f64>), SplatError> {
    let optics = view.optics(&options.constants)?;
    let (images, limit) = (Rendering::<f64>::bytes(view, options), LIMIT);
    if images > limit {
        return Err(SplatError::Memory { needed: images, limit });
    }
    let mut rendering = Rendering::empty(view, options);
    let mut splats = Vec::new();
    for position in 0..gaussians.len() {
        match project::project(gaussians, position, &optics, view.size, options) {
            Outcome::Drawn(splat) => {
                rendering.census.drawn += 1;
                splats.push(*splat);
            }
            Outcome::Invalid => rendering.census.invalid += 1,
            Outcome::OutsideDepth => rendering.census.outside_depth += 1,
            Outcome::Faint => rendering.census.faint += 1,
            Outcome::OutsidePicture => rendering.census.outside_picture += 1,
        }
    }
    // Published rasterizers sort f32 keys, so that depths that f32 cannot tell apart keep their order.
    #[expect(clippy::cast_possible_truncation, reason = "see above")]
    splats.sort_by(|a, b| (a.depth as f32).total_cmp(&(b.depth as f32)).then(a.position.cmp(&b.position)));
    Ok((splats, rendering))
}

#[cfg(test)]
mod tests;
