use glam::{DVec2, DVec3};

use crate::error::finite;
use crate::{Camera, CameraError, CameraFromWorld, Distortion, ImageSize, Lens, NormalizedIntrinsics, WorldFromCamera};

/// A camera prepared for projecting points and casting rays: the pose in both directions, and the lens with its
/// invertible range.
#[derive(Clone, Copy, Debug)]
pub struct Projector {
    pub(crate) camera_from_world: CameraFromWorld,
    pub(crate) world_from_camera: WorldFromCamera,
    pub(crate) intrinsics: NormalizedIntrinsics,
    pub(crate) lens: Lens,
}

/// The projection of a point to an image.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Projected {
    /// Position in units of the image's width and height: (0, 0) is the outer corner of the first pixel, (1, 1) that of
    /// the last.
    pub position: DVec2,
    /// Depth along the optical axis, in scene units ("z-depth"); positive unless a fisheye lens sees the point beyond 90°.
    pub depth: f64,
    /// Distance from the camera's centre, in scene units: the "depth" of iLRM and Long-LRM, measured along the unit ray.
    pub distance: f64,
}

impl Projected {
    /// The position in pixels of an image of `size`; the centre of the first pixel is at (0.5, 0.5).
    pub fn pixel(&self, size: ImageSize) -> DVec2 {
        self.position * DVec2::new(f64::from(size.width), f64::from(size.height))
    }

    /// Whether the point is inside the image: `position` in [0, 1) × [0, 1).
    pub fn is_inside(&self) -> bool {
        let inside = |value: f64| (0.0..1.0).contains(&value);
        inside(self.position.x) && inside(self.position.y)
    }
}

impl Camera {
    /// The camera prepared for projecting points and casting rays.
    ///
    /// # Errors
    /// [`CameraError::NonFinite`] for a distortion coefficient that is not finite.
    pub fn projector(&self) -> Result<Projector, CameraError> {
        Ok(Projector {
            camera_from_world: self.camera_from_world,
            world_from_camera: self.camera_from_world.inverse(),
            intrinsics: self.intrinsics,
            lens: self.distortion.lens()?,
        })
    }

    /// Projects a world point, with distortion. For many points call [`Self::projector`] once.
    ///
    /// # Errors
    /// Those of [`Projector::project`].
    pub fn project(&self, world: DVec3) -> Result<Projected, CameraError> {
        self.projector()?.project(world)
    }

    /// The camera without lens distortion, as used by every feed-forward paper on DL3DV, although its captures are
    /// distorted (DepthSplat `src/scripts/convert_dl3dv_test.py`).
    #[must_use]
    pub const fn without_distortion(&self) -> Self {
        Self { distortion: Distortion::None, ..*self }
    }
}

impl Projector {
    /// Projects a world point: `fx · x + cx` for the distorted point `x` of the z = 1 plane.
    ///
    /// # Errors
    /// [`CameraError::BehindCamera`] for a point that is not in front of the camera, [`CameraError::OutsideLens`] beyond
    /// the fold of the lens model, [`CameraError::NonFinite`] for points that are not finite or overflow.
    pub fn project(&self, world: DVec3) -> Result<Projected, CameraError> {
        let point = self.camera_from_world.transform_point(world);
        let x = self.lens.distorted_from_direction(point)?;
        let k = &self.intrinsics;
        let position = DVec2::new(finite("x", k.fx * x.x + k.cx)?, finite("y", k.fy * x.y + k.cy)?);
        Ok(Projected { position, depth: point.z, distance: point.length() })
    }

    /// Unit ray in the camera's frame through a position in units of the image's width and height.
    ///
    /// # Errors
    /// [`CameraError::OutsideLens`] if there is no such ray, [`CameraError::NonFinite`].
    pub fn camera_direction(&self, position: DVec2) -> Result<DVec3, CameraError> {
        let k = &self.intrinsics;
        self.lens.direction_from_distorted(DVec2::new((position.x - k.cx) / k.fx, (position.y - k.cy) / k.fy))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use atsplat_numeric::Tolerance;
    use glam::DMat3;

    fn camera() -> Camera {
        let pose = WorldFromCamera::new(DMat3::from_rotation_y(0.3), DVec3::new(1.0, -2.0, 0.5)).unwrap();
        Camera::pinhole(pose.inverse(), NormalizedIntrinsics::new(0.5, 0.9, 0.5, 0.52).unwrap())
    }

    #[test]
    fn the_optical_axis_projects_to_the_principal_point() {
        let camera = camera();
        let ahead = camera.camera_from_world.inverse().transform_point(DVec3::new(0.0, 0.0, 4.0));
        let seen = camera.project(ahead).unwrap();
        Tolerance::F64.assert(seen.position.to_array(), [0.5, 0.52], "principal point");
        Tolerance::F64.assert([seen.depth, seen.distance], [4.0, 4.0], "depth");
        assert!(seen.is_inside());
        let size = ImageSize { width: 640, height: 360 };
        Tolerance::F64.assert(seen.pixel(size).to_array(), [320.0, 187.2], "pixels");
    }

    #[test]
    fn points_behind_the_camera_and_not_finite_points_are_errors() {
        let camera = camera();
        let behind = camera.camera_from_world.inverse().transform_point(DVec3::new(0.1, 0.0, -4.0));
        assert!(matches!(camera.project(behind), Err(CameraError::BehindCamera { .. })));
        let centre = camera.camera_from_world.inverse().centre();
        assert!(camera.project(centre).is_err(), "the centre itself");
        assert!(camera.project(DVec3::NAN).is_err());
        assert!(camera.project(DVec3::splat(f64::MAX)).is_err());
    }

    #[test]
    fn projects_with_and_without_distortion() {
        let distortion = Distortion::OpenCv { k1: -0.1, k2: 0.0, k3: 0.0, p1: 0.0, p2: 0.0 };
        let camera = Camera { distortion, ..camera() };
        let point = camera.camera_from_world.inverse().transform_point(DVec3::new(0.5, 0.0, 1.0));
        let (with, without) = (camera.project(point).unwrap(), camera.without_distortion().project(point).unwrap());
        Tolerance::F64.assert([without.position.x], [0.75], "pinhole");
        Tolerance::F64.assert([with.position.x], [0.5 + 0.25 * (1.0 - 0.1 * 0.25)], "barrel");
    }
}
