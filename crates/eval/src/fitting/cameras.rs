//! The cameras of an optimisation's views, to render its Gaussians as it did.

use atsplat_camera::{Camera, CameraError, ImageSize};
use atsplat_fit::{Fit, FitError};
use atsplat_scene::camera_file::CameraRecord;
use atsplat_splat::Exposure;
use serde::Serialize;

use crate::reconstruct::Photos;

/// Cameras in the world of the scene, for images of the size that was optimised for: those of the training views as they were optimised,
/// with their exposures, then those of the held-out views. [`camera_file::read`](atsplat_scene::camera_file::read) reads them.
#[derive(Debug, Serialize)]
pub struct FittedCameras {
    views: Vec<CameraRecord>,
}

impl FittedCameras {
    /// The cameras of a run whose training and held-out views are the context and target views of `photos`.
    ///
    /// # Errors
    /// As [`Fit::optimised_view`], and [`FitError::Camera`] for a camera whose centre overflows in the scene's world.
    pub fn of(photos: &Photos, fit: &Fit) -> Result<Self, FitError> {
        let old_from_new = photos.trial().normalisation().new_from_old.inverse();
        let in_scene = |camera: Camera| -> Result<Camera, CameraError> {
            let pose = old_from_new.new_pose_from_old(&camera.camera_from_world.inverse())?;
            Ok(Camera { camera_from_world: pose.inverse(), ..camera })
        };
        let record = |frame: usize, camera: Camera, size: ImageSize, exposure: Option<Exposure>| {
            let name = photos.name(frame).map_or_else(|| format!("frame {frame}"), str::to_owned);
            let exposure = exposure.map(|exposure| exposure.to_3dgs());
            Ok::<_, FitError>(CameraRecord::new(frame, name, &in_scene(camera)?, size, exposure))
        };
        let mut views = Vec::new();
        for (number, view) in photos.trial().context().iter().enumerate() {
            let camera = fit.optimised_view(number)?.map_or(view.camera, |optimised| optimised.camera);
            views.push(record(view.frame, camera, view.size, fit.exposure(number))?);
        }
        for view in photos.trial().targets() {
            views.push(record(view.frame, view.camera, view.size, None)?);
        }
        Ok(Self { views })
    }
}
