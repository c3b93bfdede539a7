use atsplat_camera::{Camera, ImageSize, Lens};
use glam::{DMat3, DVec2, DVec3};

use crate::SplatError;
use crate::constants::{PrincipalPoint, RendererConstants};

/// A camera and the size of the picture it takes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct View {
    /// Pose, intrinsics in units of the picture's size, lens.
    pub camera: Camera,
    /// In pixels; at least one each way.
    pub size: ImageSize,
}

/// A view in the numbers that projecting needs.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Optics {
    pub(crate) rotation: DMat3,
    pub(crate) translation: DVec3,
    /// Centre of the camera in the world.
    pub(crate) centre: DVec3,
    /// In pixels.
    pub(crate) focal: DVec2,
    /// In pixels.
    pub(crate) principal: DVec2,
    /// `None` for a pinhole.
    pub(crate) lens: Option<Lens>,
    /// Range of `x/z` and `y/z` in which the Jacobian follows a centre.
    pub(crate) jacobian_range: [DVec2; 2],
}

impl View {
    /// Pixels in the picture.
    pub fn pixels(&self) -> usize {
        self.size.width as usize * self.size.height as usize
    }

    /// # Errors
    /// [`SplatError::View`] for a picture without pixels, [`SplatError::Camera`] for an unusable lens.
    pub(crate) fn optics(&self, constants: &RendererConstants) -> Result<Optics, SplatError> {
        if self.size.width == 0 || self.size.height == 0 {
            return Err(SplatError::View {
                what: "picture",
                expected: "at least one pixel".to_owned(),
                found: self.size.to_string(),
            });
        }
        let size = DVec2::new(f64::from(self.size.width), f64::from(self.size.height));
        let k = self.camera.intrinsics.pixel_from_normalized(self.size);
        let focal = DVec2::new(k.fx, k.fy);
        let principal = match constants.principal_point {
            PrincipalPoint::Full => DVec2::new(k.cx, k.cy),
            PrincipalPoint::Centre => size / 2.0,
        };
        let margin = constants.jacobian_margin * 0.5 * size / focal;
        let lens = match self.camera.distortion {
            atsplat_camera::Distortion::None => None,
            bent => Some(bent.lens()?),
        };
        let pose = self.camera.camera_from_world;
        Ok(Optics {
            rotation: pose.rotation(),
            translation: pose.translation(),
            centre: pose.inverse().centre(),
            focal,
            principal,
            lens,
            jacobian_range: [-principal / focal - margin, (size - principal) / focal + margin],
        })
    }
}
