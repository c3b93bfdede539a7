//! The limit on memory, as a limit on the number of Gaussians.

use atsplat_splat::sh_coefficients;

use crate::{FitConfig, FitError, TrainingView};

/// Bytes of the renderer for a Gaussian: splat, lists of tiles and their sums, screen-space gradients. A Gaussian that
/// covers many tiles needs more; the renderer's own limit then stops the run.
const RENDERER: u64 = 640;
/// Bytes per pixel of the largest image: render, gradient, buffers of loss and renderer.
const PER_PIXEL: u64 = 256;

/// Bytes for each Gaussian: value, gradient and two moments of every parameter, once more while density control copies
/// them, and statistics.
fn each(degree: u8) -> u64 {
    let floats = 11 + 3 * sh_coefficients(degree) as u64;
    4 * floats * 5 + 32 + RENDERER
}

impl FitConfig {
    /// Checks, before they are made, that this many initial Gaussians stay within the limits on memory and on their number.
    ///
    /// # Errors
    /// [`FitError::Setting`] naming the limit.
    pub fn check_start(&self, views: &[TrainingView], start: usize) -> Result<(), FitError> {
        most_gaussians(self, views, start).map(drop)
    }
}

/// Most Gaussians of a run: the configured number, or fewer if the memory does not suffice.
///
/// # Errors
/// [`FitError::Setting`] if images alone exceed the limit, or memory does not suffice for the `start` initial Gaussians.
pub(crate) fn most_gaussians(config: &FitConfig, views: &[TrainingView], start: usize) -> Result<usize, FitError> {
    let images: u64 = views.iter().map(|view| 12 * view.view.pixels() as u64).sum();
    let largest = views.iter().map(|view| view.view.pixels() as u64).max().unwrap_or(0);
    let fixed = images.saturating_add(PER_PIXEL * largest);
    let fitting = config.memory_limit.saturating_sub(fixed) / each(config.sh_degree);
    let fitting = usize::try_from(fitting).unwrap_or(usize::MAX);
    if fitting < start {
        let needed = fixed.saturating_add(each(config.sh_degree).saturating_mul(start as u64));
        return Err(FitError::Setting {
            name: "memory-limit",
            expected: format!("at least {needed} bytes for {start} Gaussians and {} images", views.len()),
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
    Ok(fitting.min(config.max_gaussians))
}
