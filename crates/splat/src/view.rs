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

    /// # Errors
    /// [`SplatError::View`] for an empty image, or one with a side that does not fit 16 bits; [`SplatError::Camera`]
    /// for an invalid lens.
    pub(crate) fn optics(&self, constants: &RendererConstants) -> Result<Optics, SplatError> {
        self.check_size()?;
        let size = DVec2::new(f64::from(self.size.width), f64::from(self.size.height));
        let k = self.camera.intrinsics.pixel_from_normalized(self.size);
        let focal = DVec2::new(k.fx, k.fy);
        let principal = match constants.principal_point {
            PrincipalPoint::Full => DVec2::new(k.cx, k.cy),
            PrincipalPoint::Centre => size / 2.0,
        };
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
