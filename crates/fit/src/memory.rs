//! The limit on memory: what it leaves for Gaussians and for the renderer.

use atsplat_splat::sh_coefficients;

use crate::{FitConfig, FitError, Strategy, TrainingViews};

/// Bytes of the renderer for a Gaussian: splat, lists of tiles and their sums, screen-space gradients. A Gaussian that
/// covers many tiles needs more; the renderer's limit then stops the run.
const RENDERER: u64 = 640;
/// Bytes per pixel of the largest image: render, gradient, buffers of loss and renderer.
const PER_PIXEL: u64 = 256;

/// How a limit on memory is shared out.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Shares {
    /// Most Gaussians: the configured number, or fewer if the memory does not suffice.
    pub(crate) gaussians: usize,
    /// Bytes for the CPU's renderer: what images and the parameters of that many Gaussians leave.
    pub(crate) renderer: u64,
}

/// Bytes for each Gaussian outside the renderer: value, gradient and two moments of every parameter, once more while density
/// control copies them, and statistics.
fn parameters(degree: u8) -> u64 {
    let floats = 11 + 3 * sh_coefficients(degree) as u64;
    4 * floats * 5 + 32
}

impl FitConfig {
    /// Checks, before they are made, that this many initial Gaussians stay within the limits on memory and on their number.
    ///
    /// # Errors
    /// [`FitError::Setting`] naming the limit.
    pub fn check_start(&self, views: &TrainingViews, start: usize) -> Result<(), FitError> {
        shares(self, views, start).map(drop)
    }
}

/// What the limit leaves for Gaussians and the renderer.
///
/// # Errors
/// [`FitError::Setting`] if images alone exceed the limit, or memory does not suffice for the `start` initial Gaussians.
pub(crate) fn shares(config: &FitConfig, views: &TrainingViews, start: usize) -> Result<Shares, FitError> {
    let images = views.image_bytes();
    let largest = views.iter().map(|view| view.view.pixels() as u64).max().unwrap_or(0);
    let fixed = images.saturating_add(PER_PIXEL.saturating_mul(largest));
    let outside_renderer = parameters(config.sh_degree);
    let each = outside_renderer + RENDERER;
    let fitting = config.memory_limit.saturating_sub(fixed) / each;
    let fitting = usize::try_from(fitting).unwrap_or(usize::MAX);
    if fitting < start {
        let needed = fixed.saturating_add(each.saturating_mul(start as u64));
        let next_to = match views.others() {
            0 => String::new(),
            others => format!(", next to {others} bytes of other images"),
        };
        return Err(FitError::Setting {
            name: "memory-limit",
            expected: format!("at least {needed} bytes for {start} Gaussians and {} images{next_to}", views.len()),
            found: config.memory_limit.to_string(),
        });
    }
    if config.max_gaussians < start {
        return Err(FitError::Setting {
            name: "max-gaussians",
            expected: format!("at least the {start} initial Gaussians"),
            found: config.max_gaussians.to_string(),
        });
    }
    let gaussians = fitting.min(config.max_gaussians);
    let most = if config.strategy == Strategy::Fixed { start } else { gaussians };
    let taken = images.saturating_add(outside_renderer.saturating_mul(most as u64));
    Ok(Shares { gaussians, renderer: config.memory_limit.saturating_sub(taken) })
}

#[cfg(test)]
mod tests {
    use atsplat_camera::{Camera, CameraFromWorld, ImageSize, NormalizedIntrinsics};
    use atsplat_splat::View;
    use glam::{DMat3, DVec3};

    use super::*;
    use crate::TrainingView;

    fn view(width: u32, height: u32) -> TrainingView {
        let pose = CameraFromWorld::new(DMat3::IDENTITY, DVec3::ZERO).unwrap();
        let intrinsics = NormalizedIntrinsics::new(1.0, 1.0, 0.5, 0.5).unwrap();
        let view = View { camera: Camera::pinhole(pose, intrinsics), size: ImageSize { width, height } };
        TrainingView { name: String::new(), rgb: Vec::new(), view }
    }

    /// Images of 635 pixels take 7620 bytes; the larger one needs 153 600 more while it is rendered. A Gaussian of degree 1 has 23
    /// parameters: 492 bytes, and 640 in the renderer.
    #[test]
    fn images_parameters_and_renderer_share_the_limit() {
        let views = || TrainingViews::from(vec![view(30, 20), view(5, 7)]);
        let config = |strategy| FitConfig { sh_degree: 1, memory_limit: 1_000_000, ..FitConfig::new(strategy, 9) };
        let of = |strategy, others| {
            let shares = shares(&config(strategy), &views().with_other_images(others), 10);
            shares.map(|shares| (shares.gaussians, shares.renderer)).map_err(|error| error.to_string())
        };
        assert_eq!(of(Strategy::Mcmc, 0), Ok((740, 1_000_000 - 7620 - 740 * 492)));
        assert_eq!(of(Strategy::Mcmc, 200_000), Ok((564, 1_000_000 - 207_620 - 564 * 492)));
        assert_eq!(of(Strategy::Fixed, 200_000), Ok((564, 1_000_000 - 207_620 - 10 * 492)), "their number stays");
        let expected = "memory-limit: expected at least 1072540 bytes for 10 Gaussians and 2 images, next to 900000 bytes of \
                        other images, found 1000000";
        assert_eq!(of(Strategy::Mcmc, 900_000), Err(expected.to_owned()));
    }

    #[test]
    fn copies_of_the_views_share_their_images() {
        let mut whole = view(2, 1);
        whole.rgb = vec![[0.25; 3]; 2];
        let views = TrainingViews::from(vec![whole]);
        let copy = views.clone();
        assert!(std::ptr::eq(views[0].rgb.as_ptr(), copy[0].rgb.as_ptr()));
        assert_eq!(copy.with_other_images(5).image_bytes(), 29);
    }
}
