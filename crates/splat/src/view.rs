use atsplat_camera::{Camera, ImageSize, Lens};
use atsplat_numeric::Extremes as _;
use glam::{DMat3, DVec2, DVec3};

use crate::SplatError;
use crate::constants::{PrincipalPoint, RendererConstants};

/// A camera and its image size.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct View {
    /// Pose, intrinsics normalised by the image size, and lens.
    pub camera: Camera,
    /// In pixels; from 1 to 65 535 per side.
    pub size: ImageSize,
}

/// A view in the form that projection needs.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Optics {
    pub(crate) rotation: DMat3,
    pub(crate) translation: DVec3,
    /// Camera centre in world coordinates.
    pub(crate) centre: DVec3,
    /// In pixels.
    pub(crate) focal: DVec2,
    /// In pixels.
    pub(crate) principal: DVec2,
    /// `None` for a pinhole.
    pub(crate) lens: Option<Lens>,
    /// Range to which `x/z` and `y/z` are clamped where the Jacobian is evaluated.
    pub(crate) jacobian_range: [DVec2; 2],
}

impl View {
    /// Number of pixels.
    pub fn pixels(&self) -> usize {
        self.size.width as usize * self.size.height as usize
    }

    /// # Errors
    /// [`SplatError::View`] for an empty image, or one with a side that does not fit 16 bits.
    pub(crate) fn check_size(&self) -> Result<(), SplatError> {
        const SIDES: std::ops::RangeInclusive<u32> = 1..=u16::MAX as u32;
        if SIDES.contains(&self.size.width) && SIDES.contains(&self.size.height) {
            return Ok(());
        }
        let expected = format!("from {} to {} pixels a side", SIDES.start(), SIDES.end());
        Err(SplatError::View { what: "image size", expected, found: self.size.to_string() })
    }

    /// Focal lengths and principal point in pixels, with which the view is projected.
    ///
    /// # Errors
    /// [`SplatError::View`] for a field of view of which [`PrincipalPoint::FieldOfView`] has no focal length.
    pub fn focal_and_principal(&self, used: PrincipalPoint) -> Result<[[f64; 2]; 2], SplatError> {
        let size = [f64::from(self.size.width), f64::from(self.size.height)];
        let k = self.camera.intrinsics.pixel_from_normalized(self.size);
        let (principal, centre) = ([k.cx, k.cy], size.map(|side| side / 2.0));
        // There, the focal lengths of the field of view would be the camera's, except for rounding.
        let is_central = principal.map(f64::to_bits) == centre.map(f64::to_bits);
        match used {
            PrincipalPoint::Full => Ok([[k.fx, k.fy], principal]),
            PrincipalPoint::Centre => Ok([[k.fx, k.fy], centre]),
            PrincipalPoint::FieldOfView if is_central => Ok([[k.fx, k.fy], centre]),
            PrincipalPoint::FieldOfView => {
                let fov = self.camera.intrinsics.field_of_view();
                let focal = [size[0] / (2.0 * (fov.x / 2.0).tan()), size[1] / (2.0 * (fov.y / 2.0).tan())];
                if !focal.iter().all(|focal| focal.is_finite() && *focal > 0.0) {
                    let found = format!("{:e} and {:e} radians", fov.x, fov.y);
                    return Err(SplatError::View {
                        what: "field of view",
                        expected: "a focal length for it".to_owned(),
                        found,
                    });
                }
                Ok([focal, centre])
            }
        }
    }

    /// # Errors
    /// [`SplatError::View`] for an empty image, one with a side that does not fit 16 bits, and as
    /// [`Self::focal_and_principal`]; [`SplatError::Camera`] for an invalid lens.
    pub(crate) fn optics(&self, constants: &RendererConstants) -> Result<Optics, SplatError> {
        self.check_size()?;
        let size = DVec2::new(f64::from(self.size.width), f64::from(self.size.height));
        let [focal, principal] = self.focal_and_principal(constants.principal_point)?.map(DVec2::from_array);
        let lens = match self.camera.distortion {
            atsplat_camera::Distortion::None => None,
            distortion => Some(distortion.lens()?),
        };
        let [low, high] = visible_slopes(lens.as_ref(), [-principal / focal, (size - principal) / focal]);
        // A lens may make the range infinite; without a margin, 0 · ∞ must not become NaN.
        let margin =
            if constants.jacobian_margin > 0.0 { constants.jacobian_margin * 0.5 * (high - low) } else { DVec2::ZERO };
        let pose = self.camera.camera_from_world;
        Ok(Optics {
            rotation: pose.rotation(),
            translation: pose.translation(),
            centre: pose.inverse().centre(),
            focal,
            principal,
            lens,
            jacobian_range: [low - margin, high + margin],
        })
    }
}

/// Range of undistorted slopes visible in the image, given its corners in distorted slopes.
///
/// With distortion, corners may see further out than edges, or less far, so the whole border is sampled. If a border
/// point has no undistorted slope, every slope up to the lens's own limit counts as visible.
fn visible_slopes(lens: Option<&Lens>, [low, high]: [DVec2; 2]) -> [DVec2; 2] {
    const STEPS: u32 = 32;
    let Some(lens) = lens else { return [low, high] };
    let limit = lens.angle_limit();
    let limit = if limit < std::f64::consts::FRAC_PI_2 { limit.tan() } else { f64::INFINITY };
    let along = (0..=STEPS).map(|step| low.lerp(high, f64::from(step) / f64::from(STEPS)));
    let border = along.flat_map(|at| [(at.x, low.y), (at.x, high.y), (low.x, at.y), (high.x, at.y)]);
    let empty = [DVec2::INFINITY, DVec2::NEG_INFINITY];
    border.fold(empty, |[least, most], (x, y)| match lens.undistorted_from_distorted(DVec2::new(x, y)) {
        Ok(slope) => [zip_with(least, slope, f64::minimum_of), zip_with(most, slope, f64::maximum_of)],
        Err(_) => [DVec2::splat(-limit), DVec2::splat(limit)],
    })
}

fn zip_with(a: DVec2, b: DVec2, of_two: impl Fn(f64, f64) -> f64) -> DVec2 {
    DVec2::new(of_two(a.x, b.x), of_two(a.y, b.y))
}

#[cfg(test)]
mod tests {
    use atsplat_camera::{CameraFromWorld, NormalizedIntrinsics};
    use atsplat_numeric::Tolerance;

    use super::*;

    const SIZE: ImageSize = ImageSize { width: 40, height: 30 };

    fn view([fx, fy, cx, cy]: [f64; 4]) -> View {
        View {
            camera: Camera::pinhole(CameraFromWorld::IDENTITY, NormalizedIntrinsics::new(fx, fy, cx, cy).unwrap()),
            size: SIZE,
        }
    }

    /// Horizontally, the field of view is a sum of two arctangents; vertically, it is seen obliquely by ⅛ of the distance.
    #[test]
    fn a_centred_projection_has_the_field_of_view_of_the_camera() {
        let view = view([0.8, 1.1, 0.6, 0.5]);
        let [focal, principal] = view.focal_and_principal(PrincipalPoint::FieldOfView).unwrap();
        let angle = (0.6f64 / 0.8).atan() + (0.4f64 / 0.8).atan();
        let expected = [20.0 / (0.5 * angle).tan(), 30.0 * 1.1 * (1.0f64 + 0.125 * 0.125).sqrt()];
        Tolerance::absolute(1e-12).assert(focal, expected, "focal lengths");
        Tolerance::EXACT.assert(principal, [20.0, 15.0], "principal point");
        assert!(focal[0] > 1.01 * 40.0 * 0.8, "longer than the camera's: {focal:?}");
        let [focal, principal] = view.focal_and_principal(PrincipalPoint::Centre).unwrap();
        Tolerance::EXACT.assert(focal, [40.0 * 0.8, 30.0 * 1.1], "the camera's own, around the centre");
        Tolerance::EXACT.assert(principal, [20.0, 15.0], "principal point");
        let [focal, principal] = view.focal_and_principal(PrincipalPoint::Full).unwrap();
        Tolerance::EXACT.assert(focal, [40.0 * 0.8, 30.0 * 1.1], "the camera's own");
        Tolerance::EXACT.assert(principal, [40.0 * 0.6, 15.0], "the camera's own");
    }

    /// Otherwise, every result of a centred camera would move by rounding.
    #[test]
    fn a_central_principal_point_leaves_the_focal_lengths_as_they_are() {
        for focal in [0.1, 0.7, 0.873_412_9, 1.3, 55.5] {
            let view = view([focal, 1.1 * focal, 0.5, 0.5]);
            let [of_centre, of_camera] = [PrincipalPoint::FieldOfView, PrincipalPoint::Full]
                .map(|used| view.focal_and_principal(used).unwrap().as_flattened().to_vec());
            assert_eq!(bits(&of_centre), bits(&of_camera), "{focal}");
        }
    }

    fn bits(values: &[f64]) -> Vec<u64> {
        values.iter().map(|value| value.to_bits()).collect()
    }

    #[test]
    fn a_field_of_view_of_zero_is_an_error() {
        let view = view([1e12, 1e12, 0.6, 0.5]);
        let constants = RendererConstants::named("pixelsplat-family").unwrap();
        let outcome = view.optics(&constants);
        assert!(matches!(outcome, Err(SplatError::View { what: "field of view", .. })), "{outcome:?}");
        assert!(view.optics(&RendererConstants::default()).is_ok());
    }
}
