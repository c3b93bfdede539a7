use atsplat_camera::{Camera, ImageSize};
use glam::{DMat3, DVec2};

/// A camera and the size of its image, which together determine pixel coordinates.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct View {
    /// Pose, normalised intrinsics and lens.
    pub camera: Camera,
    /// Size of the image that points were found in.
    pub size: ImageSize,
}

/// The same scene point in two images, in pixels with the centre of the top left pixel at (0.5, 0.5).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PointMatch {
    /// Position in the first image.
    pub first: DVec2,
    /// Position in the second image.
    pub second: DVec2,
}

impl View {
    /// The matrix K: pixels from the camera's z = 1 plane, without distortion.
    pub fn pixel_from_plane(&self) -> DMat3 {
        let k = self.camera.intrinsics.pixel_from_normalized(self.size);
        DMat3::from_cols_array(&[k.fx, 0.0, 0.0, 0.0, k.fy, 0.0, k.cx, k.cy, 1.0])
    }

    /// `pixel` without lens distortion, in pixels of the same K; `None` outside the domain of the lens model.
    pub fn undistorted(&self, pixel: DVec2) -> Option<DVec2> {
        let k = self.camera.intrinsics.pixel_from_normalized(self.size);
        let (focal, centre) = (DVec2::new(k.fx, k.fy), DVec2::new(k.cx, k.cy));
        let lens = self.camera.distortion.lens().ok()?;
        Some(lens.undistorted_from_distorted((pixel - centre) / focal).ok()? * focal + centre)
    }

    /// Length of the image's diagonal in pixels.
    pub fn diagonal(&self) -> f64 {
        f64::from(self.size.width).hypot(f64::from(self.size.height))
    }
}
