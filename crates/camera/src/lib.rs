//! Camera geometry: intrinsics, lens distortion, poses, rays, trajectories, and the pose normalisations of the
//! feed-forward papers. Pure f64 arithmetic without files or tensors.
//!
//! Camera axes are OpenCV's everywhere: +x right, +y down, +z forward. A pixel `(column, row)` covers
//! `[column, column + 1) × [row, row + 1)`, so its centre is at `(column + 0.5, row + 0.5)`.

mod axes;
mod centre_spread;
mod distortion;
mod error;
mod framing;
mod image_size;
mod intrinsics;
mod no_fields;
mod normalise;
mod plucker;
mod polynomial;
mod pose;
mod projection;
mod rays;
mod similarity;
mod so3;
mod spline;
mod trajectory;
mod turntable;

pub use centre_spread::CentreSpread;
pub use distortion::{Distortion, Lens};
pub use error::CameraError;
pub use framing::Sphere;
pub use image_size::ImageSize;
pub use intrinsics::{CropRect, FieldOfView, NormalizedIntrinsics, PixelIntrinsics, PrincipalPointRule};
pub use no_fields::no_fields;
pub use normalise::{Fallback, MeanCameraScale, Normalised, PoseNormalisation, normalise};
pub use pose::{CameraFromWorld, ROTATION_RESIDUAL_LIMIT, WorldFromCamera, orthonormality_residual};
pub use projection::{Projected, Projector};
pub use rays::{DirectionScale, PixelRays, Ray};
pub use similarity::Similarity;
pub use spline::CameraSpline;
pub use trajectory::{Spacing, Trajectory};
pub use turntable::Turntable;

/// A posed camera: extrinsics, intrinsics and lens distortion.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Camera {
    /// World-to-camera transform with OpenCV axes.
    pub camera_from_world: CameraFromWorld,
    /// Pinhole intrinsics in units of the image's width and height.
    pub intrinsics: NormalizedIntrinsics,
    /// Lens distortion on the `z = 1` plane.
    pub distortion: Distortion,
}

impl Camera {
    /// A camera without lens distortion.
    pub const fn pinhole(camera_from_world: CameraFromWorld, intrinsics: NormalizedIntrinsics) -> Self {
        Self { camera_from_world, intrinsics, distortion: Distortion::None }
    }
}
