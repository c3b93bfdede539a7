use atsplat_camera::{Camera, ImageSize};
use glam::{DMat3, DVec2};

/// A camera and the size of its picture: together they speak of pixels.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct View {
    /// Pose, normalised intrinsics and lens.
    pub camera: Camera,
    /// Size of the picture that points were found in.
    pub size: ImageSize,
}

/// The same scene point in two pictures, in pixels with the centre of the top left pixel at (0.5, 0.5).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PointMatch {
    /// Where it is in the first picture.
    pub first: DVec2,
    /// Where it is in the second picture.
    pub second: DVec2,
}

impl View {
    /// Pixels from the camera's z = 1 plane: the matrix K, without the lens.
    pub fn pixel_from_plane(&self) -> DMat3 {
        let k = self.camera.intrinsics.pixel_from_normalized(self.size);
        DMat3::from_cols_array(&[k.fx, 0.0, 0.0, 0.0, k.fy, 0.0, k.cx, k.cy, 1.0])
    }

    /// Where `pixel` would be without the lens's distortion, in pixels of the same K; `None` where the
    /// lens model does not reach.
    pub fn undistorted(&self, pixel: DVec2) -> Option<DVec2> {
        let k = self.camera.intrinsics.pixel_from_normalized(self.size);
        let (focal, centre) = (DVec2::new(k.fx, k.fy), DVec2::new(k.cx, k.cy));
        let lens = self.camera.distortion.lens().ok()?;
        let straight = lens.undistorted_from_distorted((pixel - centre) / focal).ok()?;
        Some(straight * focal + centre)
    }

    /// Length of the picture's diagonal in pixels.
    pub fn diagonal(&self) -> f64 {
        f64::from(self.size.width).hypot(f64::from(self.size.height))
    }
}
