use serde::{Deserialize, Serialize};

use crate::error::{finite, positive};
use crate::{CameraError, ImageSize};

/// A rectangle of whole pixels inside an image.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub struct CropRect {
    /// First column.
    pub column: u32,
    /// First row.
    pub row: u32,
    /// Width and height.
    pub size: ImageSize,
}

impl CropRect {
    /// The centred rectangle of `size`, with the half-pixel of odd margins rounded down:
    /// `row = (h_in − h_out) // 2` (pixelSplat `src/dataset/shims/crop_shim.py`).
    ///
    /// # Errors
    /// [`CameraError::CropOutside`] if `size` is empty or larger than `source`.
    pub fn centred(source: ImageSize, size: ImageSize) -> Result<Self, CameraError> {
        let margin = |outer: u32, inner: u32| outer.checked_sub(inner).map(|m| m / 2);
        match (margin(source.width, size.width), margin(source.height, size.height)) {
            (Some(column), Some(row)) if size.width > 0 && size.height > 0 => Ok(Self { column, row, size }),
            _ => Err(CameraError::CropOutside {
                crop: Self { column: 0, row: 0, size },
                width: source.width,
                height: source.height,
            }),
        }
    }
}

/// How cropping an image changes the normalised principal point.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum PrincipalPointRule {
    /// Not at all, as in pixelSplat, MVSplat, DepthSplat, NoPoSplat and iLRM (`crop_shim.py`). Exact only for a centred
    /// principal point and an even margin.
    #[default]
    Frozen,
    /// `cx' = (cx·w − column) / w'`, the exact position of the optical axis.
    Corrected,
}

/// Pinhole intrinsics in units of the image's size: `x_pixels = width · (fx · X/Z + cx)`.
///
/// The convention of RE10K files and `.torch` chunks (pixelSplat `README.md:119`). Focal lengths are positive, all
/// numbers finite.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct NormalizedIntrinsics {
    /// Horizontal focal length over image width; > 0.
    pub fx: f64,
    /// Vertical focal length over image height; > 0.
    pub fy: f64,
    /// Principal point over image width; 0.5 is the centre.
    pub cx: f64,
    /// Principal point over image height; 0.5 is the centre.
    pub cy: f64,
}

/// Pinhole intrinsics in pixels of one image size: `x = fx · X/Z + cx`, with pixel centres at + 0.5.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct PixelIntrinsics {
    /// Horizontal focal length in pixels; > 0.
    pub fx: f64,
    /// Vertical focal length in pixels; > 0.
    pub fy: f64,
    /// Principal point column in pixels from the left edge.
    pub cx: f64,
    /// Principal point row in pixels from the top edge.
    pub cy: f64,
}

/// Field of view in radians.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FieldOfView {
    /// Angle between the rays through the middles of the left and right edges.
    pub x: f64,
    /// Angle between the rays through the middles of the top and bottom edges.
    pub y: f64,
}

macro_rules! checked_new {
    ($name:ident) => {
        impl $name {
            /// Checked constructor.
            ///
            /// # Errors
            /// [`CameraError`] for a focal length that is not positive or a number that is not finite.
            pub fn new(fx: f64, fy: f64, cx: f64, cy: f64) -> Result<Self, CameraError> {
                Ok(Self {
                    fx: positive("fx", fx)?,
                    fy: positive("fy", fy)?,
                    cx: finite("cx", cx)?,
                    cy: finite("cy", cy)?,
                })
            }
        }
    };
}

checked_new!(NormalizedIntrinsics);
checked_new!(PixelIntrinsics);

impl NormalizedIntrinsics {
    /// The intrinsics in pixels of an image of `size`.
    pub fn pixel_from_normalized(&self, size: ImageSize) -> PixelIntrinsics {
        let (w, h) = (f64::from(size.width), f64::from(size.height));
        PixelIntrinsics { fx: self.fx * w, fy: self.fy * h, cx: self.cx * w, cy: self.cy * h }
    }

    /// The intrinsics after cropping an image of size `source`: focal lengths are multiplied by `w / w'` and `h / h'`, the
    /// principal point follows `rule`.
    ///
    /// # Errors
    /// [`CameraError::CropOutside`] if `crop` is empty or not inside `source`.
    pub fn cropped(&self, source: ImageSize, crop: CropRect, rule: PrincipalPointRule) -> Result<Self, CameraError> {
        let fits = |start: u32, length: u32, limit: u32| {
            length > 0 && start.checked_add(length).is_some_and(|end| end <= limit)
        };
        if !fits(crop.column, crop.size.width, source.width) || !fits(crop.row, crop.size.height, source.height) {
            return Err(CameraError::CropOutside { crop, width: source.width, height: source.height });
        }
        let (w_in, h_in) = (f64::from(source.width), f64::from(source.height));
        let (w_out, h_out) = (f64::from(crop.size.width), f64::from(crop.size.height));
        let (cx, cy) = match rule {
            PrincipalPointRule::Frozen => (self.cx, self.cy),
            PrincipalPointRule::Corrected => {
                ((self.cx * w_in - f64::from(crop.column)) / w_out, (self.cy * h_in - f64::from(crop.row)) / h_out)
            }
        };
        Ok(Self { fx: self.fx * (w_in / w_out), fy: self.fy * (h_in / h_out), cx, cy })
    }

    /// Field of view as defined by pixelSplat's `get_fov` (`src/geometry/projection.py`): the angles between the rays
    /// through the middles of opposite edges, which depend on the principal point.
    pub fn field_of_view(&self) -> FieldOfView {
        let angle = |focal: f64, centre: f64, other: f64| {
            let ray = |edge: f64| glam::DVec3::new((edge - centre) / focal, other, 1.0).normalize();
            ray(0.0).dot(ray(1.0)).clamp(-1.0, 1.0).acos()
        };
        let middle = |focal: f64, centre: f64| (0.5 - centre) / focal;
        FieldOfView {
            x: angle(self.fx, self.cx, middle(self.fy, self.cy)),
            y: angle(self.fy, self.cy, middle(self.fx, self.cx)),
        }
    }
}

impl PixelIntrinsics {
    /// The intrinsics in units of the image's `size`.
    ///
    /// # Errors
    /// [`CameraError::NotPositive`] for an empty image or focal length, [`CameraError::NonFinite`].
    pub fn normalized_from_pixel(&self, size: ImageSize) -> Result<NormalizedIntrinsics, CameraError> {
        let (w, h) = (positive("width", f64::from(size.width))?, positive("height", f64::from(size.height))?);
        NormalizedIntrinsics::new(self.fx / w, self.fy / h, self.cx / w, self.cy / h)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use atsplat_numeric::Tolerance;

    const RE10K: ImageSize = ImageSize { width: 640, height: 360 };

    #[test]
    fn pixel_intrinsics_round_trip() {
        let k = NormalizedIntrinsics::new(0.48, 0.86, 0.5, 0.51).unwrap();
        let back = k.pixel_from_normalized(RE10K).normalized_from_pixel(RE10K).unwrap();
        Tolerance::F64.assert([back.fx, back.fy, back.cx, back.cy], [k.fx, k.fy, k.cx, k.cy], "intrinsics");
    }

    #[test]
    fn frozen_and_corrected_principal_points() {
        let source = ImageSize { width: 455, height: 256 };
        let crop = CropRect::centred(source, ImageSize { width: 256, height: 256 }).unwrap();
        assert_eq!((crop.column, crop.row), (99, 0), "the odd margin is rounded down");
        let k = NormalizedIntrinsics::new(0.5, 0.9, 0.5, 0.5).unwrap();
        let frozen = k.cropped(source, crop, PrincipalPointRule::Frozen).unwrap();
        assert_eq!(frozen, NormalizedIntrinsics { fx: 0.5 * (455.0 / 256.0), ..k });
        let corrected = k.cropped(source, crop, PrincipalPointRule::Corrected).unwrap();
        Tolerance::F64.assert([corrected.cx], [(227.5 - 99.0) / 256.0], "half a pixel to the right");
    }

    #[test]
    fn a_crop_outside_is_an_error() {
        let k = NormalizedIntrinsics::new(0.5, 0.9, 0.5, 0.5).unwrap();
        let size = ImageSize { width: 10, height: 10 };
        for (column, row) in [(631, 0), (0, 351), (u32::MAX, 0)] {
            assert!(k.cropped(RE10K, CropRect { column, row, size }, PrincipalPointRule::Frozen).is_err());
        }
        assert!(CropRect::centred(size, RE10K).is_err());
    }

    #[test]
    fn a_centred_field_of_view_is_twice_the_arctangent() {
        let fov = NormalizedIntrinsics::new(0.5, 1.0, 0.5, 0.5).unwrap().field_of_view();
        Tolerance::F64.assert([fov.x, fov.y], [2.0 * 1f64.atan(), 2.0 * 0.5f64.atan()], "field of view");
    }

    #[test]
    fn zero_focal_lengths_and_nan_are_errors() {
        assert!(NormalizedIntrinsics::new(0.0, 1.0, 0.5, 0.5).is_err());
        assert!(NormalizedIntrinsics::new(-1.0, 1.0, 0.5, 0.5).is_err());
        assert!(NormalizedIntrinsics::new(1.0, 1.0, f64::NAN, 0.5).is_err());
    }
}
