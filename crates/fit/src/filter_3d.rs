//! Mip-Splatting's 3D smoothing filter (autonomousvision/mip-splatting `scene/gaussian_model.py`, `compute_3D_filter`): no
//! Gaussian is smaller than a fifth of the variance of a pixel of the camera that sees it best.

use atsplat_camera::Projector;
use atsplat_numeric::{Extremes as _, narrowed};
use atsplat_splat::{GaussianCounts, RendererConstants, View};
use glam::DVec3;
use rayon::prelude::*;

use crate::{FitError, StopReason};

/// A camera sees Gaussians this share of its image's width and height beyond the border.
const BORDER: f64 = 0.15;
/// Variance of the filter in pixels of the best camera.
const VARIANCE: f64 = 0.2;
/// Blur of the 2D Mip filter, in square pixels.
pub const MIP_BLUR: f64 = RendererConstants::MIP_BLUR;

/// The cameras that limit how fine a Gaussian can be.
#[derive(Debug)]
pub struct Cameras {
    projectors: Vec<Projector>,
    largest_focal: f64,
    near: f64,
}

impl Cameras {
    /// The training cameras; Gaussians nearer than `near` are not seen (0.2 in the published code, its rasterizer's plane).
    ///
    /// # Errors
    /// [`FitError::Camera`] for a lens that is not finite.
    pub fn new<'a>(views: impl IntoIterator<Item = &'a View>, near: f64) -> Result<Self, FitError> {
        let (mut cameras, mut largest_focal) = (Vec::new(), 0.0);
        for view in views {
            let focal = view.camera.intrinsics.pixel_from_normalized(view.size).fx;
            largest_focal = if focal > largest_focal { focal } else { largest_focal };
            cameras.push(view.camera.projector()?);
        }
        Ok(Self { projectors: cameras, largest_focal, near })
    }

    /// Standard deviations of the filter: the smallest depth in any camera that sees the mean, over the largest focal
    /// length, times √0.2. Means that no camera sees have the largest depth of those that are seen.
    ///
    /// # Errors
    /// [`StopReason::NothingVisible`] if no mean is seen.
    pub fn filters(&self, means: &[[f32; 3]]) -> Result<Vec<f32>, StopReason> {
        let nearest: Vec<Option<f64>> = means.par_iter().map(|mean| self.nearest(*mean)).collect();
        let seen = nearest.iter().flatten();
        let largest =
            seen.fold(None, |most: Option<f64>, depth| Some(most.map_or(*depth, |most| most.maximum_of(*depth))));
        let largest =
            largest.ok_or_else(|| StopReason::NothingVisible { near: self.near, counts: self.unseen(means) })?;
        let filter = |depth: &Option<f64>| narrowed(depth.unwrap_or(largest) / self.largest_focal * VARIANCE.sqrt());
        Ok(nearest.iter().map(filter).collect())
    }

    /// Means that no camera sees: outside the image of one, or else nearer than the near plane for all.
    fn unseen(&self, means: &[[f32; 3]]) -> GaussianCounts {
        let is_deep_enough = |mean: &&[f32; 3]| {
            let mean = DVec3::from_array(mean.map(f64::from));
            self.projectors.iter().any(|camera| camera.project(mean).is_ok_and(|seen| seen.depth > self.near))
        };
        let outside_image = means.iter().filter(is_deep_enough).count() as u64;
        GaussianCounts { outside_depth: means.len() as u64 - outside_image, outside_image, ..GaussianCounts::default() }
    }

    fn nearest(&self, mean: [f32; 3]) -> Option<f64> {
        let mean = DVec3::from_array(mean.map(f64::from));
        let inside = |position: f64| (-BORDER..=1.0 + BORDER).contains(&position);
        let mut nearest = None;
        for camera in &self.projectors {
            if let Ok(seen) = camera.project(mean)
                && seen.depth > self.near
                && inside(seen.position.x)
                && inside(seen.position.y)
                && nearest.is_none_or(|least| seen.depth < least)
            {
                nearest = Some(seen.depth);
            }
        }
        nearest
    }
}
