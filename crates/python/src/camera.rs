//! Cameras as plain numbers; `cameras.py` has them as arrays.

use atsplat_camera::{Camera, CameraFromWorld, Distortion, ImageSize, NormalizedIntrinsics};
use atsplat_splat::View;

use crate::error::Failure;

/// `camera_from_world` row by row (3×4), normalised `(fx, fy, cx, cy)`, lens model and its coefficients, width and height in pixels.
pub(crate) type Numbers = ([f64; 12], [f64; 4], String, Vec<f64>, u32, u32);

/// The numbers of a camera.
pub(crate) fn numbers(camera: &Camera, size: ImageSize) -> Numbers {
    let NormalizedIntrinsics { fx, fy, cx, cy } = camera.intrinsics;
    let (lens, coefficients) = camera.distortion.in_opencv_order().unwrap_or(("pinhole", Vec::new()));
    let pose = camera.camera_from_world.to_rows();
    (pose, [fx, fy, cx, cy], lens.to_owned(), coefficients, size.width, size.height)
}

/// The camera of these numbers.
pub(crate) fn view((pose, [fx, fy, cx, cy], lens, coefficients, width, height): &Numbers) -> Result<View, Failure> {
    let Some(distortion) = Distortion::from_opencv_order(lens, coefficients) else {
        return Err(Failure::invalid(
            "distortion",
            format!(
                "expected pinhole, opencv (k1, k2, p1, p2, k3) or fisheye (k1, k2, k3, k4), found {lens} {coefficients:?}"
            ),
        ));
    };
    let camera_from_world = CameraFromWorld::from_rows(pose)?;
    let intrinsics = NormalizedIntrinsics::new(*fx, *fy, *cx, *cy)?;
    let size = ImageSize { width: *width, height: *height };
    Ok(View { camera: Camera { camera_from_world, intrinsics, distortion }, size })
}
