//! Numbers into cameras: intrinsics, lens distortion, poses, rays, trajectories and the pose
//! normalisations that the feed-forward papers apply. Pure f64; knows nothing of files or tensors.
//!
//! Camera axes are OpenCV's everywhere: +x right, +y down, +z forward. A pixel `(column, row)` covers
//! `[column, column + 1) × [row, row + 1)`, so its centre is at `(column + 0.5, row + 0.5)`.

mod distortion;
mod error;
mod intrinsics;
mod pose;

pub use distortion::Distortion;
pub use error::CameraError;
pub use intrinsics::{CropRect, FieldOfView, ImageSize, NormalizedIntrinsics, PixelIntrinsics, PrincipalPointRule};
pub use pose::{CameraFromWorld, WorldFromCamera};

/// One posed camera: where it stands, how it projects, how its lens bends.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Camera {
    /// World to camera, OpenCV axes.
    pub camera_from_world: CameraFromWorld,
    /// Pinhole part of the projection, in units of the picture's width and height.
    pub intrinsics: NormalizedIntrinsics,
    /// Lens distortion between the pinhole's `z = 1` plane and the picture.
    pub distortion: Distortion,
}

impl Camera {
    /// A camera without lens distortion.
    pub const fn pinhole(camera_from_world: CameraFromWorld, intrinsics: NormalizedIntrinsics) -> Self {
        Self { camera_from_world, intrinsics, distortion: Distortion::None }
    }
}
